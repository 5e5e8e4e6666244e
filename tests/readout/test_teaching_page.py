"""The teaching page in a browser: Voila serves it, Playwright moves its sliders.

The picture of the page in the documentation is made by these tests:

CORRIDOR_SCREENSHOT=notebooks/images/bike_wheel.png python -m pytest -k slider \\
    tests/rolling_shutter/test_teaching_page.py
"""

import datetime
import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from kit import lesson

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "04b_bike_wheel.py"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE = 240  # s: kernels compile, and machines are busy


def chromium():
    """Path of a Chromium: CORRIDOR_CHROMIUM, or what the system has."""
    named = os.environ.get("CORRIDOR_CHROMIUM")
    found = [named] if named else [shutil.which(name) for name in BROWSERS]
    return next((path for path in found if path and Path(path).exists()), None)


class TestTheLessonWithoutABrowser:
    def test_every_slider_moves_the_picture(self):
        start = lesson.Setting()
        first = lesson.photograph(start)
        for change in (
            {"readout_ms": 60.0},
            {"turns_per_second": 1.0},
            {"sense": "ccw"},
            {"exposure_ms": 4.0},
            {"row_direction": "right"},
        ):
            moved = lesson.photograph(lesson.Setting(**{**vars(start), **change}))
            assert (moved != first).mean() > 0.02

    @pytest.mark.slow
    def test_what_is_set_is_measured(self):
        found = lesson.measure(lesson.Setting(40.0, 2.5, "ccw", 1.0, "up"))
        assert found.readout_ms == pytest.approx(40.0, rel=0.012)
        assert (found.rotation_sense, found.row_direction) == ("ccw", "up")

    def test_a_frame_of_the_longest_exposure_takes_less_than_a_tenth_of_a_second(self):
        slowest = lesson.Setting(80.0, 3.0, exposure_ms=5.0)
        lesson.photograph(slowest)
        taken = []
        for _ in range(5):
            started = time.process_time()
            lesson.png(lesson.photograph(slowest))
            taken.append(time.process_time() - started)
        assert min(taken) < 0.1

    def test_spokes_of_a_clockwise_wheel_are_further_apart_on_the_right(self):
        """Rows from top to bottom: there the spokes move down, as the rows do."""

        for sense, closer in (("cw", "left"), ("ccw", "right")):
            left, right = spokes_met(lesson.photograph(lesson.Setting(80.0, 3.0, sense, 0.0)))
            assert (left > right) == (closer == "left") and left != right

    @pytest.mark.slow
    def test_own_photographs_become_a_readout_or_a_sentence(self):
        """What a person uploads: the bytes of two files and the turns a second."""
        static, rotating = uploads()
        page = lesson.own_photos()
        page.turns.value = 1.5
        page.go.click()
        assert "Choose both" in page.answer.value
        for upload, (name, content) in ((page.static, static), (page.rotating, rotating)):
            upload.value = [
                {"name": name, "type": "image/jpeg", "size": len(content), "content": content,
                 "last_modified": datetime.datetime.fromtimestamp(0, datetime.UTC)}
            ]  # fmt: skip
        page.go.click()
        assert re.search(r"measured (49|50)\.\d ± 0\.\d ms", settled(page.answer))
        assert bytes(page.picture.value).startswith(b"\x89PNG")
        page.turns.value = 0.0
        page.go.click()
        assert "turns a second" in settled(page.answer)

    def test_a_file_that_is_no_photograph_is_named(self):
        said = lesson._or_sentence(lesson.measure_own, ("a.txt", b"no"), ("b.jpg", b"no"), 1.0)
        assert said.startswith("a.txt is not a photograph")

    def test_without_a_kernel_the_page_is_the_picture_of_a_measurement(self):
        bundle = lesson.wheel_page()._repr_mimebundle_()
        assert bytes(bundle["image/png"]).startswith(b"\x89PNG")
        assert "application/vnd.jupyter.widget-view+json" in bundle
        assert "0x" not in bundle["text/plain"]


def uploads():
    """Name and bytes of two JPEGs: a wheel at rest, and at 1.5 turns a second read in 50 ms."""
    pictures = [lesson.photograph_at_rest(), lesson.photograph(lesson.Setting(50.0, 1.5))]
    return [
        (name, cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes())
        for name, picture in zip(("still.jpg", "turning.jpg"), pictures, strict=True)
    ]


def spokes_met(picture, radius=100):
    """Number of bright arcs on the left and on the right half of a circle about the axis."""
    phi = np.linspace(-np.pi / 2, np.pi / 2, 600)
    middle = (lesson.SIZE[0] - 1) / 2, (lesson.SIZE[1] - 1) / 2
    met = []
    for side in (-1, 1):
        x = (middle[0] + side * radius * np.cos(phi)).astype(np.float32)
        y = (middle[1] + radius * np.sin(phi)).astype(np.float32)
        line = cv2.remap(picture, x[None], y[None], cv2.INTER_LINEAR)[0].astype(float)
        bright = line > 0.5 * (np.median(line) + line.max())
        met.append(int((bright[1:] & ~bright[:-1]).sum()))
    return met


def settled(answer, patience=PATIENCE):
    """The text of an answer once it no longer says that it is being measured."""
    until = time.monotonic() + patience
    while "measuring" in answer.value and time.monotonic() < until:
        time.sleep(0.05)
    return answer.value


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Address of the teaching page, served by Voila from the paired text file."""
    pytest.importorskip("voila", reason="voila, which serves the page, is not installed")
    import jupytext

    folder = tmp_path_factory.mktemp("voila")
    path = folder / "04b_bike_wheel.ipynb"
    jupytext.write(jupytext.read(NOTEBOOK), path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    log = (folder / "log.txt").open("wb")
    server = subprocess.Popen(
        [sys.executable, "-m", "voila", str(path), "--no-browser", f"--port={port}",
         "--Voila.ip=127.0.0.1", "--show_tracebacks=True"],
        stdout=log, stderr=subprocess.STDOUT, cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(NOTEBOOK.parent), *sys.path])},
    )  # fmt: skip
    address = f"http://127.0.0.1:{port}/"
    try:
        until = time.monotonic() + PATIENCE
        while True:
            try:
                urllib.request.urlopen(f"{address}voila/static/", timeout=5)
                break
            except urllib.error.HTTPError:
                break  # it answers
            except OSError:
                if server.poll() is not None or time.monotonic() > until:
                    said = (folder / "log.txt").read_text(errors="replace")[-2000:]
                    pytest.fail(f"Voila does not start:\n{said}")
                time.sleep(0.2)
        yield address
    finally:
        server.terminate()
        server.wait(30)
        log.close()


@pytest.fixture(scope="module")
def page(served):
    """The teaching page in a headless browser, its first measurement done."""
    browser_path = chromium()
    if browser_path is None:
        pytest.skip(
            "no Chromium: install it (Debian: apt-get install chromium) or let CORRIDOR_CHROMIUM "
            "name one"
        )
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 900, "height": 1400})
        page.set_default_timeout(1000 * PATIENCE)
        page.goto(served)
        page.get_by_text(re.compile(r"measured \d")).first.wait_for()
        yield page
        browser.close()


@pytest.mark.slow
class TestInABrowser:
    def test_moving_a_slider_changes_the_picture_and_the_number(self, page):
        picture = page.locator("img.widget-image").nth(1)
        slider = page.get_by_role("slider").first

        def seen():
            return picture.evaluate(
                "img => fetch(img.src).then(r => r.arrayBuffer()).then(b => "
                "Array.from(new Uint8Array(b)))"
            )

        def number():
            said = page.get_by_text(re.compile(r"measured \d")).first
            said.wait_for()
            return float(re.search(r"measured ([\d.]+)", said.inner_text())[1])

        before = bytes(seen())
        assert before.startswith(b"\x89PNG")
        assert number() == pytest.approx(30.0, abs=0.4)
        slider.focus()
        for _ in range(4):
            page.keyboard.press("PageUp")
        for _ in range(5):
            page.keyboard.press("ArrowRight")
        wanted = float(page.locator(".widget-readout").first.inner_text())
        assert wanted > 30
        page.get_by_text(f"set {wanted:.1f} ms").wait_for()
        page.get_by_text("measuring").wait_for(state="detached")
        assert number() == pytest.approx(wanted, rel=0.012)
        after = bytes(seen())
        assert after.startswith(b"\x89PNG") and after != before
        keep = os.environ.get("CORRIDOR_SCREENSHOT")
        if keep:
            end = page.get_by_text("Where nothing moves above").bounding_box()["y"]
            page.screenshot(path=keep, clip={"x": 0, "y": 0, "width": 900, "height": end - 10})

    def test_no_code_and_no_error_is_shown(self, page):
        text = page.locator("body").inner_text()
        assert "import lesson" not in text and "from kit" not in text
        assert "Traceback" not in text and "Error" not in text
        assert "Guess first" in text and "Your own photo" in text

    def test_own_photographs_are_uploaded_and_measured(self, page):
        for what, (name, content) in zip(("at rest", "turning"), uploads(), strict=True):
            with page.expect_file_chooser() as chooser:
                page.get_by_role("button", name=f"wheel {what}").click()
            file = {"name": name, "mimeType": "image/jpeg", "buffer": content}
            chooser.value.set_files(file)
            page.get_by_role("button", name=f"wheel {what} (1)").wait_for()
        turns = page.get_by_label("turns a second").last
        turns.fill("1.5")
        turns.press("Tab")
        page.get_by_role("button", name="measure", exact=True).click()
        page.get_by_text(re.compile(r"measured (49|50)\.\d")).wait_for()
