"""The site: built without a warning, read without a network, and as the package is."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from browser import chromium

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))


@pytest.fixture(scope="module")
def lessons():
    import lessons

    return lessons


def test_every_position_of_the_wheel_has_its_number_or_is_known_to_have_none(lessons):
    table = json.loads(lessons.MEASURED.read_text(encoding="utf-8"))
    keys = {key for key, _ in lessons.positions()}
    assert set(table) <= keys
    assert len(table) >= 0.9 * len(keys)
    readout = np.array([float(key.split()[0]) for key in table])
    found, sigma = np.array(list(table.values())).T
    # Their sigmas hold a lens that nobody knows; the lesson's has no distortion.
    inside = np.abs(found - readout) < 1.96 * sigma
    assert inside.sum() >= scipy.stats.binom.ppf(0.001, len(table), 0.95)


def test_code_of_a_chapter_is_folded_and_its_text_is_not():
    import build

    cells = [{"cell_type": kind, "metadata": {}, "source": ""} for kind in ("markdown", "code")]
    text, code = json.loads(build.folded(json.dumps({"cells": cells})))["cells"]
    assert code["metadata"]["tags"] == ["hide-input"] and "tags" not in text["metadata"]


def test_the_first_page_has_what_was_measured_and_pictures_of_the_chapters(tmp_path):
    import build

    (tmp_path / "index.md").write_text((ROOT / "docs/pages/index.md").read_text(encoding="utf-8"))
    build.first_page(tmp_path)
    page = (tmp_path / "index.md").read_text(encoding="utf-8")
    shown = re.findall(r"\((pictures/\w+\.png)\)", page)
    assert len(shown) == len(build.FIRST) + len(build.GALLERY)
    assert all((tmp_path / one).read_bytes().startswith(b"\x89PNG") for one in shown)
    times = json.loads((ROOT / "docs/against_ceres.json").read_text(encoding="utf-8"))["sizes"]
    for one in times:
        assert f"{one['observations']:,} observations" in page
        assert one["ratio"] == pytest.approx(one["ceres_s"] / one["ours_s"], rel=0.2)
    rates = json.loads((ROOT / "docs/guarantees.json").read_text(encoding="utf-8"))["flights"]
    assert rates["named, effects"] in page
    assert "EVIDENCE" not in page and "GALLERY" not in page


@pytest.mark.slow
def test_the_numbers_of_the_wheel_are_what_the_package_measures(lessons):
    table = json.loads(lessons.MEASURED.read_text(encoding="utf-8"))
    every = list(lessons.positions())
    for n in np.random.default_rng(3).choice(len(every), 3, replace=False):
        key, setting = every[n]
        assert lessons.measured(setting) == pytest.approx(table.get(key), abs=0.02)


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
@pytest.mark.parametrize("setting", [(30, 2, "cw", 0.5), (60, 3, "ccw", 4)])
def test_the_wheel_of_the_page_is_that_of_the_package(lessons, setting):
    from kit import lesson

    from corridor.tools.readout import render

    readout, turns, sense, exposure = setting
    turns *= 1 if sense == "cw" else -1
    wanted = render.wheel(
        lesson._VIEW, render.Shutter(readout / 1e3, exposure / 1e3), turns, phase_deg=20.0,
        **lesson._WHEEL,
    )  # fmt: skip
    scene = lessons.scene()
    asked = {"readout_s": readout / 1e3, "exposure_s": exposure / 1e3, "turns": turns}
    script = (
        f"const wheel = require({json.dumps(str(ROOT / 'docs/_static/wheel.js'))});"
        f"const light = wheel.light({json.dumps(scene)}, "
        f"{json.dumps({**asked, 'phase': scene['phase']})});"
        "process.stdout.write(Buffer.from(light.buffer));"
    )
    drawn = subprocess.run(["node", "-e", script], capture_output=True, check=True).stdout
    assert np.abs(np.frombuffer(drawn).reshape(wanted.shape) - wanted).max() < 1e-9


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built once."""
    pytest.importorskip("myst_nb", reason="the extra docs is not installed")
    out = tmp_path_factory.mktemp("site") / "html"
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "build.py"), str(out)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return out


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = chromium()
    if path is None:
        pytest.skip("no Chromium is installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def opened(browser, path, width):
    """A page of the site; whatever it asks of another address, or complains of, is kept."""
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.away, page.wrong = [], []
    page.on("request", lambda r: page.away.append(r.url) if r.url.startswith("http") else None)
    page.on("pageerror", lambda e: page.wrong.append(str(e)))
    page.goto(path.as_uri())
    return page


@pytest.mark.night  # It takes minutes, and a workflow builds it on every change.
class TestTheSite:
    def test_links_lead_somewhere_and_pictures_say_what_they_show(self, site):
        from html.parser import HTMLParser
        from urllib.parse import unquote, urlsplit

        class Links(HTMLParser):
            def handle_starttag(self, tag, attributes):
                found = dict(attributes)
                for key in ("href", "src"):
                    if key in found:
                        links.append(found[key])
                if tag == "img" and not found.get("alt"):
                    mute.append(found.get("src"))

        pages = sorted(site.rglob("*.html"))
        assert len(pages) > 50
        for path in pages:
            links, mute = [], []
            Links().feed(path.read_text(encoding="utf-8"))
            assert not mute, path
            for link in links:
                parts = urlsplit(link)
                if parts.scheme or not parts.path:
                    continue
                assert (path.parent / unquote(parts.path)).exists(), (path, link)

    @pytest.mark.parametrize("width", [1200, 390])
    @pytest.mark.parametrize(
        "name",
        ["index", "how", "api", "commands", "format", "glossary", "notebooks/05_missing_effect",
         "effects/rolling_shutter", "lessons/wheel", "lessons/ground", "notebooks/verdicts"],
    )  # fmt: skip
    def test_a_page_fits_the_screen_and_asks_nobody_else(self, site, browser, name, width):
        page = opened(browser, site / f"{name}.html", width)
        over = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.evaluate(over) <= 0
        assert not page.away and not page.wrong
        page.close()

    def test_search_works_without_a_server(self, site, browser):
        page = opened(browser, site / "search.html", 1200)
        page.goto((site / "search.html").as_uri() + "?q=lever+arm")
        page.locator("#search-results li a").first.wait_for()
        assert "lever" in page.locator("#search-results").inner_text().lower()
        page.close()

    def test_the_static_wheel_moves_and_says_what_was_measured(self, site, browser, lessons):
        page = opened(browser, site / "lessons" / "wheel.html", 390)
        pixels = "Array.from(document.getElementById('turning').getContext('2d')" \
            ".getImageData(0, 0, 480, 360).data)"  # fmt: skip
        before = page.evaluate(pixels)
        page.locator("#readout").focus()
        page.keyboard.press("ArrowRight")
        assert page.locator("#readout-value").inner_text() == "40 ms"
        assert page.evaluate(pixels) != before
        table = json.loads(lessons.MEASURED.read_text(encoding="utf-8"))
        assert f"{table['40 2 cw 0.5'][0]:.2f}" in page.locator("#number").inner_text()
        page.close()

    def test_arrows_on_the_ground_grow_with_the_error(self, site, browser):
        page = opened(browser, site / "lessons" / "ground.html", 390)
        large = page.locator("#said").inner_text()
        page.locator("#size").focus()
        for _ in range(4):
            page.keyboard.press("ArrowLeft")
        assert page.locator("#said").inner_text() != large
        assert "horizontal 0 mm, height 0 mm" in page.locator("#said").inner_text()
        page.close()
