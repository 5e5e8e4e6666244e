"""Ten pupils open the bicycle wheel at once: time to the picture, to the moved slider, memory.

python -m benchmarks.classroom [--visitors 10] [--screenshots FOLDER]

Serves the page as `python run.py lesson` does, on 127.0.0.1. Each visitor is a page of its own
profile in one headless Chromium, which needs the same processors as the server: on a class's own
machines both are faster. Every visitor sets the slider elsewhere, so that nothing is remembered.
"""

import argparse
import asyncio
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from playwright.async_api import Page, async_playwright

ROOT = Path(__file__).parents[1]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_MS = 120_000
PHONE = {"viewport": {"width": 390, "height": 844}, "device_scale_factor": 2}
DESK = {"viewport": {"width": 1200, "height": 900}}
_DRAWN = (
    "() => { const i = document.getElementById('turning');"
    " return i.complete && i.naturalWidth > 0 && !!i.dataset.of; }"
)
_MOVED = (
    "readout => (document.getElementById('turning').dataset.of || '')"
    ".includes('readout_ms=' + readout)"
)
_MEASURED = "() => /ms/.test(document.getElementById('answer').textContent)"


async def visit(page: Page, address: str, readout_ms: int) -> dict[str, float]:
    """Seconds from the first request to the wheel, and from the slider to wheel and answer."""
    began = time.monotonic()
    await page.goto(address)
    await page.wait_for_function(_DRAWN, timeout=PATIENCE_MS)
    drawn = time.monotonic()
    await page.wait_for_function(_MEASURED, timeout=PATIENCE_MS)
    slid = time.monotonic()
    await page.eval_on_selector(
        "[name=readout_ms]",
        "(knob, ms) => { knob.value = ms;"
        " knob.dispatchEvent(new Event('input', {bubbles: true})); }",
        readout_ms,
    )
    await page.wait_for_function(_MOVED, arg=readout_ms, timeout=PATIENCE_MS)
    moved = time.monotonic()
    await page.wait_for_function(_MEASURED, timeout=PATIENCE_MS)
    answer = await page.inner_text("#answer")
    found = re.search(r"[\d.]+", answer.replace(",", "."))
    return {
        "page": drawn - began,
        "moved": moved - slid,
        "measured": time.monotonic() - slid,
        "off_ms": abs(float(found[0]) - readout_ms) if found else float("nan"),
    }


async def lesson(address: str, visitors: int, screenshots: Path | None) -> list[dict[str, float]]:
    """All visitors at once; half of them with a phone."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        pages = []
        for n in range(visitors):
            context = await browser.new_context(**(PHONE if n % 2 else DESK))
            pages.append(await context.new_page())
        found = await asyncio.gather(
            *(visit(page, address, 12 + 6 * n) for n, page in enumerate(pages))
        )
        if screenshots:
            screenshots.mkdir(parents=True, exist_ok=True)
            for name, page in zip(("wide", "narrow"), pages[:2], strict=False):
                await page.screenshot(path=screenshots / f"{name}.png")
                await page.screenshot(path=screenshots / f"{name}_whole.png", full_page=True)
        await browser.close()
    return found


def of_process(number: int) -> tuple[float, float, float]:
    """Resident and highest memory, MB, and processor seconds of a process (Linux)."""
    status = Path(f"/proc/{number}/status").read_text()
    kilobytes = [int(re.search(rf"{key}:\s+(\d+)", status)[1]) for key in ("VmRSS", "VmHWM")]
    ticks = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[11:13]
    return kilobytes[0] / 1024, kilobytes[1] / 1024, sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    """Print a row a visitor, and what the server needed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--visitors", type=int, default=10)
    parser.add_argument("--port", type=int, default=8899)
    parser.add_argument("--screenshots", type=Path)
    options = parser.parse_args()
    paths = [str(ROOT / "notebooks"), str(ROOT)]
    server = subprocess.Popen(
        [sys.executable, "-u", "-m", "kit.classroom", "--port", str(options.port)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        began = time.monotonic()
        line = next(line for line in server.stdout if "http://" in line)
        print(f"ready after {time.monotonic() - began:.1f} s")
        before = of_process(server.pid)
        found = asyncio.run(lesson(line.split()[-1], options.visitors, options.screenshots))
        after = of_process(server.pid)
    finally:
        server.terminate()
        server.wait()
    found.sort(key=lambda one: one["page"])
    print("visitor  page s  slider to wheel s  slider to answer s  answer off by ms")
    for n, one in enumerate(found, start=1):
        print(
            f"{n:7}  {one['page']:6.1f}  {one['moved']:17.1f}  {one['measured']:18.1f}"
            f"  {one['off_ms']:16.2f}"
        )
    print(
        f"server: {before[0]:.0f} MB before, {after[0]:.0f} MB after, {after[1]:.0f} MB at most; "
        f"{after[2] - before[2]:.1f} s of processor for {options.visitors} visitors"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
