"""The bicycle wheel as a page for a class: one program serves everybody, no kernel runs.

`python run.py lesson --class` starts it. A picture is drawn when a slider asks for it and kept
for the next one who asks for the same; the readout is measured when the sliders rest.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import os
import re
import sys
import threading
from collections.abc import Callable
from functools import lru_cache
from http import HTTPStatus
from http.server import ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from corridor.core.errors import InputError, WorkFailed
from corridor.interface import figures
from corridor.tools.readout import Readout
from kit import lesson
from kit.apart import Apart
from kit.guarded import GuardedHandler, GuardedServer, Refused, addresses

PAGE = Path(__file__).with_name("wheel.html")
PORT = 8866
# Settings whose pictures (some 60 kB each) and measurements are kept.
KEPT = 1000
# Two photographs as a phone writes them, and the same in base64 with what stands beside it.
MOST_FILES = 30_000_000
MOST_BYTES = MOST_FILES * 4 // 3 + 10_000
# The full resolution of most phones; those with more pixels store fewer unless asked.
MOST_PIXELS = 50_000_000
# Bodies that are received or wait to be measured: the memory that waiting may take is their bytes.
MOST_UPLOADS = 4
# Two photographs of 50 million pixels in colour took 1.0 GB, and 35 s on two busy cores.
MEASURING_S, MEASURING_MB = 60.0, 2000

# As many at once as the machine has cores: more would only wait for each other.
_work = threading.BoundedSemaphore(max(os.cpu_count() or 1, 1))
# Figures share the fonts of the process.
_drawing = threading.Lock()
_uploads = threading.BoundedSemaphore(MOST_UPLOADS)


@lru_cache(maxsize=KEPT)
def turning(setting: lesson.Setting) -> bytes:
    """PNG of the turning wheel."""
    with _work:
        return lesson.png(lesson.photograph(setting))


@lru_cache(maxsize=KEPT)
def measured(setting: lesson.Setting) -> Readout | str:
    """What is read off the picture, or the sentence why nothing is."""
    with _work:
        return lesson.or_sentence(lesson.measure, setting)


@lru_cache(maxsize=100)
def explained(setting: lesson.Setting) -> bytes:
    """PNG of how it was measured; empty where it was not."""
    found = measured(setting)
    return b"" if isinstance(found, str) else _picture(found)


def own(body: bytes) -> dict:
    """The answer to two photographs: what is shown in words, and a picture of the measurement.

    body: JSON with still and turning, each {name, data (base64)}; turns, as somebody types it;
    sense: cw, ccw or nothing.
    Raises InputError where it is not that.
    """
    try:
        posted = json.loads(body)
        photos = [_photo(posted.get(key), key) for key in ("still", "turning")]
        turns, sense = posted.get("turns", ""), posted.get("sense") or None
    except (ValueError, AttributeError, TypeError, RecursionError):
        raise InputError("This did not come from our page: load it anew") from None
    if sense not in (None, "cw", "ccw") or not isinstance(turns, (str, int, float)):
        raise InputError("This did not come from our page: load it anew")
    turns = lesson.or_sentence(lesson.number_typed, turns)
    if isinstance(turns, str):
        return {"said": turns}
    found = lesson.or_sentence(lesson.measure_own, *photos, turns, sense, MOST_PIXELS)
    if isinstance(found, str):
        return {"said": found}
    said = f"{lesson.told(found)}, at {turns:g} turns a second"
    drawn = base64.b64encode(_picture(found)).decode("ascii")
    return {"measured": said, "warnings": found.warnings, "picture": drawn}


def _photo(posted: dict | None, name: str) -> tuple[str, bytes]:
    posted = posted or {}
    return str(posted.get("name", name))[:100], base64.b64decode(posted.get("data", ""))


_measured_apart = Apart(own, MEASURING_S, MEASURING_MB)


def _picture(found: Readout) -> bytes:
    with _drawing:
        return figures.readout_picture(found)._repr_png_()


class Lesson(GuardedHandler):
    """Answers of the page's address."""

    def do_GET(self):
        """The page, its pictures, and what is measured in them."""
        address = urlsplit(self.path)
        words = dict(parse_qsl(address.query))
        answers: dict[str, Callable[[], tuple[str, bytes]]] = {
            "/": lambda: ("text/html; charset=utf-8", PAGE.read_bytes()),
            "/still.png": lambda: ("image/png", _still()),
            "/turning.png": lambda: ("image/png", turning(lesson.Setting.of(words))),
            "/shown.png": lambda: ("image/png", explained(lesson.Setting.of(words))),
            "/measured": lambda: _json(_told(measured(lesson.Setting.of(words)))),
        }
        self._answer(answers.get(address.path, _nothing))

    def do_POST(self):
        """Somebody's own photographs."""
        self._answer(self._own if self.path == "/own" else _nothing)
        if not self._received:
            self.pass_over()

    def _own(self) -> tuple[str, bytes]:
        length = self.length(MOST_BYTES, _TOO_LARGE)
        if not _uploads.acquire(blocking=False):
            raise Refused(HTTPStatus.SERVICE_UNAVAILABLE, _BUSY)
        try:
            self._received = True
            return _json(_measured_apart(self.body(length)))
        finally:
            _uploads.release()

    def _answer(self, made: Callable[[], tuple[str, bytes]]) -> None:
        self._received = False
        status, said = HTTPStatus.OK, ""
        try:
            self.admit()
            kind, content = made()
        except Refused as refused:
            status, said = refused.status, str(refused)
        except InputError as error:
            status, said = HTTPStatus.BAD_REQUEST, str(error)
        except WorkFailed as error:
            said = str(error)
        except (OSError, ValueError):  # the visitor has gone
            self.close_connection = True
            return
        except Exception as error:
            status, said = HTTPStatus.INTERNAL_SERVER_ERROR, "This cannot be shown: load it anew."
            print(f"{self.path[:80]!r} failed ({type(error).__name__})", file=sys.stderr)
        if said:
            kind, content = _json({"said": said})
        if status != HTTPStatus.OK:
            self.close_connection = True
        self.answer(status, kind, content)


_TOO_LARGE = f"The photographs are too large: together at most {MOST_FILES / 1e6:.0f} MB, as JPEG."
_BUSY = "Many are measuring just now: try again in a minute."


def _nothing() -> tuple[str, bytes]:
    raise Refused(HTTPStatus.NOT_FOUND, "There is nothing here.")


def _policy(page: str) -> str:
    """The Content-Security-Policy of a page: its own script and style, pictures, and requests."""

    def digests(tag):
        found = re.findall(rf"<{tag}>(.*?)</{tag}>", page, flags=re.S)
        each = (base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in found)
        return " ".join(f"'sha256-{one}'" for one in each)

    return (
        f"default-src 'none'; img-src 'self' data:; connect-src 'self'; "
        f"script-src {digests('script')}; style-src {digests('style')}; "
        "form-action 'none'; base-uri 'none'"
    )


Lesson.policy = _policy(PAGE.read_text(encoding="utf-8"))


@lru_cache(maxsize=1)
def _still() -> bytes:
    return lesson.png(lesson.photograph_at_rest())


def _told(found: Readout | str) -> dict:
    return {"said": found} if isinstance(found, str) else {"measured": lesson.told(found)}


def _json(content: dict) -> tuple[str, bytes]:
    return "application/json", json.dumps(content).encode()


def serve(host: str = "127.0.0.1", port: int = PORT) -> ThreadingHTTPServer:
    """A server of the lesson, ready to `serve_forever`; port 0 takes a free one.

    Everything is compiled and the first picture measured: nobody waits for that.
    Raises InputError where the port is taken.
    """
    try:
        server = GuardedServer((host, port), Lesson)
    except OSError as error:
        raise InputError(
            f"port {port} of {host} cannot be used ({error.strerror}): give another, --port N"
        ) from None
    _still()
    start = lesson.Setting()
    turning(start), measured(start), explained(start)
    return server


class Page:
    """The lesson in a notebook: its page, a picture where no kernel runs."""

    def _repr_mimebundle_(self, **_) -> dict:
        server = serve(port=0)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        here = f"http://127.0.0.1:{server.server_port}/"
        return {
            "text/plain": f"Sliders and a turning wheel: {lesson.Setting()}",
            "text/html": f'<iframe src="{here}" width="100%" height="900" '
            'style="border: none"></iframe>',
            "image/png": figures.readout_picture(lesson.measure(lesson.Setting()))._repr_png_(),
        }


def wheel_page() -> Page:
    """Sliders, the wheel at rest and turning, the readout measured, and one's own photographs."""
    return Page()


def main(arguments: list[str] | None = None) -> int:
    """Serve the lesson until Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python run.py lesson", description=__doc__)
    parser.add_argument(
        "--class", action="store_true", dest="everybody", help="for everybody in the network"
    )
    parser.add_argument(
        "--address", help="with --class: address of this machine in the network of the class"
    )
    parser.add_argument("--port", type=int, default=PORT, help="port (default %(default)s)")
    options = parser.parse_args(arguments)
    print("Preparing the first picture (the first time half a minute) ...", flush=True)
    here = addresses() if options.everybody else []
    where = (options.address or (here or ["127.0.0.1"])[0]) if options.everybody else "127.0.0.1"
    try:
        # Of several networks only the class's one: nobody in the others is asked to come.
        server = serve(where, options.port)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"The bicycle wheel is at  http://{where}:{server.server_port}/", flush=True)
    others = [one for one in here if one != where]
    if others:
        print(f"If the class is in another network: --class --address {' or '.join(others)}")
    print("Ctrl-C ends it.", flush=True)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print()
    finally:
        server.server_close()
        _measured_apart.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
