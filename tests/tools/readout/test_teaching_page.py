"""The teaching page in a browser: served as README says, Playwright moves its sliders.

The picture of the page in the documentation is made by these tests:

CORRIDOR_SCREENSHOT=notebooks/images/bike_wheel.png python -m pytest -k slider \\
    tests/tools/readout/test_teaching_page.py
"""

import base64
import json
import os
import re
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest
from browser import chromium
from kit import classroom, lesson

from corridor.core.errors import InputError

ROOT = Path(__file__).parents[3]
PATIENCE = 240  # s: kernels compile, and machines are busy


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
        """What a person uploads: two files and the turns a second, as they are typed."""
        (one, still), (two, turning) = uploads()
        posted = {
            "still": {"name": one, "data": base64.b64encode(still).decode()},
            "turning": {"name": two, "data": base64.b64encode(turning).decode()},
            "turns": "1,5",
        }
        answer = classroom.own(json.dumps(posted).encode())
        assert re.search(r"measured (49|50)\.\d ± 0\.\d ms", answer["measured"])
        assert "at 1.5 turns a second" in answer["measured"]
        assert base64.b64decode(answer["picture"]).startswith(b"\x89PNG")

    @pytest.mark.parametrize(("typed", "number"), [("1,6", 1.6), ("1.6", 1.6), (" 2 ", 2.0)])
    def test_a_number_has_a_point_or_a_comma(self, typed, number):
        assert lesson.number_typed(typed) == number

    @pytest.mark.parametrize("typed", ["", "much", "0", "-1", "nan", "1,6,2"])
    def test_what_is_no_speed_is_a_sentence_without_an_option(self, typed):
        said = classroom.own(json.dumps({"turns": typed}).encode())["said"]
        assert "turns a second" in said and "--" not in said

    def test_a_file_that_is_no_photograph_is_named(self):
        said = lesson.or_sentence(lesson.measure_own, ("a.txt", b"no"), ("b.jpg", b"no"), 1.0)
        assert said.startswith("a.txt is not a photograph")

    @pytest.mark.parametrize(
        "words", [{"readout_ms": "much"}, {"sense": "up"}, {"turns_per_second": "1e9"}, {"x": "1"}]
    )
    def test_an_address_that_no_slider_makes_is_refused(self, words):
        with pytest.raises(InputError):
            lesson.Setting.of(words)

    def test_the_page_asks_nobody_else(self):
        page = classroom.PAGE.read_text(encoding="utf-8")
        assert not re.findall(r"https?://|<link[^>]+href=\"(?!data:)|@import|url\(", page)
        assert "--" not in re.sub(r"<style>.*?</style>|<script>.*?</script>|<!DOCTYPE", "", page,
                                  flags=re.S)  # fmt: skip


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


@pytest.fixture(scope="module")
def here():
    """Address of a server in this process."""
    server = classroom.serve(port=0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.mark.slow
class TestTheServer:
    def test_thirty_at_once_get_page_and_picture_and_nothing_is_left_of_them(self, here):
        """No kernel, no session: when they are gone, so are their threads."""
        seen = []

        def visit(number):
            for path in ("", "still.png", f"turning.png?readout_ms={10 + number}"):
                with urllib.request.urlopen(here + path, timeout=PATIENCE) as answer:
                    seen.append((answer.status, answer.read()[:8]))

        before = threading.active_count()
        pupils = [threading.Thread(target=visit, args=(k,)) for k in range(30)]
        for pupil in pupils:
            pupil.start()
        for pupil in pupils:
            pupil.join()
        assert len(seen) == 90 and all(status == 200 for status, _ in seen)
        assert sum(content == b"\x89PNG\r\n\x1a\n" for _, content in seen) == 60
        until = time.monotonic() + 10
        while threading.active_count() > before and time.monotonic() < until:
            time.sleep(0.05)
        assert threading.active_count() <= before

    def test_what_is_measured_is_kept_for_the_next_one(self, here):
        address = here + "measured?readout_ms=33&turns_per_second=2"
        first = json.load(urllib.request.urlopen(address, timeout=PATIENCE))
        began = time.monotonic()
        assert json.load(urllib.request.urlopen(address, timeout=PATIENCE)) == first
        assert time.monotonic() - began < 1.0
        assert re.match(r"measured 3[23]\.\d ± ", first["measured"])

    @pytest.mark.parametrize(
        ("path", "status"), [("nowhere", 404), ("turning.png?sense=up", 400), ("../run.py", 404)]
    )
    def test_what_is_not_there_is_said(self, here, path, status):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(here + path, timeout=PATIENCE)
        assert refused.value.code == status

    def test_a_port_that_is_taken_is_a_sentence(self, here):
        with pytest.raises(InputError, match="give another, --port N"):
            classroom.serve(port=int(here.rsplit(":", 1)[1].strip("/")))

    def test_in_a_notebook_it_is_the_page_and_a_picture_where_nothing_runs(self):
        bundle = classroom.wheel_page()._repr_mimebundle_()
        assert bytes(bundle["image/png"]).startswith(b"\x89PNG")
        address = re.search('src="(http://127[^"]+)"', bundle["text/html"])[1]
        with urllib.request.urlopen(address, timeout=PATIENCE) as answer:
            assert b"Guess first" in answer.read()
        assert "0x" not in bundle["text/plain"]


@pytest.fixture(scope="module")
def served():
    """Address of the teaching page, served in a process of its own, as `run.py lesson` does."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folders = [str(ROOT / "notebooks"), str(ROOT)]
    server = subprocess.Popen(
        [sys.executable, "-m", "kit.classroom", "--port", str(port)],
        stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([*folders, *sys.path])},
    )  # fmt: skip
    try:
        said = [server.stdout.readline(), server.stdout.readline()]
        address = re.search(r"http://\S+", said[1])
        assert address, said
        yield address[0]
    finally:
        server.terminate()
        server.wait(30)


@pytest.fixture(scope="module")
def browser():
    """A headless browser."""
    path = chromium()
    if path is None:
        pytest.skip(
            "no Chromium: install it (Debian: apt-get install chromium) or let CORRIDOR_CHROMIUM "
            "name one"
        )
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def opened(browser, address, width, asked=None):
    """The page at a width, its first measurement done; asked: a list of all that it asks for."""
    page = browser.new_page(viewport={"width": width, "height": 844})
    page.set_default_timeout(1000 * PATIENCE)
    if asked is not None:
        page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    page.get_by_text(re.compile(r"measured \d")).first.wait_for()
    return page


@pytest.mark.slow
class TestInABrowser:
    def test_moving_a_slider_changes_the_picture_and_the_number(self, served, browser):
        asked = []
        page = opened(browser, served, 1200, asked)
        slider = page.get_by_role("slider", name="readout time")
        before = page.locator("#turning").screenshot()
        assert number(page) == pytest.approx(30.0, abs=0.4)
        slider.focus()
        for _ in range(25):
            page.keyboard.press("ArrowRight")
        wanted = float(slider.input_value())
        assert wanted == 55
        page.get_by_text(re.compile(r"measured 5\d")).first.wait_for()
        assert number(page) == pytest.approx(wanted, rel=0.012)
        page.wait_for_function(
            "wanted => document.getElementById('turning').dataset.of.includes(wanted)",
            arg="readout_ms=55",
        )
        assert page.locator("#turning").screenshot() != before
        assert all(address.startswith(("data:", served)) for address in asked)
        keep = os.environ.get("CORRIDOR_SCREENSHOT")
        if keep:
            page.evaluate("scrollTo(0, 0)")
            page.screenshot(path=keep)

    def test_on_a_phone_the_wheel_stays_round_and_both_pictures_in_sight(self, served, browser):
        page = opened(browser, served, 390)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for knob in page.locator("#knobs input, #knobs select").all():
            knob.scroll_into_view_if_needed()
            for picture in page.locator(".pair img").all():
                box = picture.bounding_box()
                assert box["width"] / box["height"] == pytest.approx(4 / 3, rel=0.01)
                assert box["y"] >= 0 and box["y"] + box["height"] <= 844
                assert box["x"] >= 0 and box["x"] + box["width"] <= 390

    def test_own_photographs_are_uploaded_and_measured(self, served, browser):
        page = opened(browser, served, 390)
        for what, (name, content) in zip(("at rest", "turning"), uploads(), strict=True):
            file = {"name": name, "mimeType": "image/jpeg", "buffer": content}
            page.get_by_label(f"wheel {what}").set_input_files(file)
        page.get_by_label("turns a second").last.fill("1,5")
        page.get_by_role("button", name="measure").click()
        page.get_by_text(re.compile(r"measured (49|50)\.\d.* at 1\.5 turns")).wait_for()
        assert page.locator("#own-shown").evaluate("img => img.naturalWidth") > 300


def number(page):
    return float(re.search(r"measured ([\d.]+)", page.locator("#answer").inner_text())[1])
