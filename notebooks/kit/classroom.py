"""The bicycle wheel as a page for a class: one program serves everybody, no kernel runs.

`python run.py lesson --class` starts it. A picture is drawn when a slider asks for it and kept
for the next one who asks for the same; the readout is measured when the sliders rest.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import socket
import sys
import threading
from collections.abc import Callable
from functools import lru_cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from corridor.core.errors import InputError
from corridor.interface import figures
from corridor.tools.readout import Readout
from kit import lesson

PAGE = Path(__file__).with_name("wheel.html")
PORT = 8866
# Settings whose pictures (some 60 kB each) and measurements are kept.
KEPT = 1000
# Two photographs as a phone writes them, in text.
MOST_BYTES = 40_000_000

# As many at once as the machine has cores: more would only wait for each other.
_work = threading.BoundedSemaphore(max(os.cpu_count() or 1, 1))
# Figures share the fonts of the process.
_drawing = threading.Lock()


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


def own(posted: dict) -> dict:
    """The answer to two photographs: what is shown in words, and a picture of the measurement.

    posted: still and turning, each {name, data (base64)}; turns, as somebody types it; sense.
    """
    photos = []
    for key in ("still", "turning"):
        one = posted.get(key) or {}
        photos.append((str(one.get("name", key)), base64.b64decode(one.get("data", ""))))
    sense = posted.get("sense") or None
    with _work:
        turns = lesson.or_sentence(lesson.number_typed, posted.get("turns", ""))
        if isinstance(turns, str):
            return {"said": turns}
        found = lesson.or_sentence(lesson.measure_own, *photos, turns, sense)
    if isinstance(found, str):
        return {"said": found}
    said = f"{lesson.told(found)}, at {turns:g} turns a second"
    drawn = base64.b64encode(_picture(found)).decode("ascii")
    return {"measured": said, "warnings": found.warnings, "picture": drawn}


def _picture(found: Readout) -> bytes:
    with _drawing:
        return figures.readout_picture(found)._repr_png_()


class Lesson(BaseHTTPRequestHandler):
    """Answers of the page's address."""

    protocol_version = "HTTP/1.1"

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
        self._answer(answers.get(address.path))

    def do_POST(self):
        """Somebody's own photographs."""
        length = int(self.headers.get("Content-Length") or 0)
        if self.path != "/own" or length > MOST_BYTES:
            self.close_connection = True
            self._answer(None if self.path != "/own" else lambda: _json(_TOO_LARGE))
            return
        posted = self.rfile.read(length)
        self._answer(lambda: _json(own(json.loads(posted))))

    def _answer(self, made: Callable[[], tuple[str, bytes]] | None) -> None:
        status = HTTPStatus.OK
        try:
            kind, content = made() if made else ("text/plain", b"there is nothing here")
            status = status if made else HTTPStatus.NOT_FOUND
        except (InputError, ValueError, AttributeError) as error:
            kind, content, status = "text/plain", str(error).encode(), HTTPStatus.BAD_REQUEST
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        """Nothing: a class asks for thousands of pictures."""


_TOO_LARGE = {"said": "The photographs are too large: together at most 30 MB, as JPEG."}


@lru_cache(maxsize=1)
def _still() -> bytes:
    return lesson.png(lesson.photograph_at_rest())


def _told(found: Readout | str) -> dict:
    return {"said": found} if isinstance(found, str) else {"measured": lesson.told(found)}


def _json(content: dict) -> tuple[str, bytes]:
    return "application/json", json.dumps(content).encode()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    # A class opens the page at once.
    request_queue_size = 128

    def handle_error(self, request, client_address):
        """Nothing: a pupil who goes on before a picture has come is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


def serve(host: str = "127.0.0.1", port: int = PORT) -> ThreadingHTTPServer:
    """A server of the lesson, ready to `serve_forever`; port 0 takes a free one.

    Everything is compiled and the first picture measured: nobody waits for that.
    Raises InputError where the port is taken.
    """
    try:
        server = _Server((host, port), Lesson)
    except OSError as error:
        raise InputError(
            f"port {port} cannot be used ({error.strerror}): give another, --port N"
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


def address_here() -> str:
    """The address of this machine in the network that it is in; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return probe.getsockname()[0]
        except OSError:
            return "127.0.0.1"


def main(arguments: list[str] | None = None) -> int:
    """Serve the lesson until Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python run.py lesson", description=__doc__)
    parser.add_argument(
        "--class", action="store_true", dest="everybody", help="for everybody in the network"
    )
    parser.add_argument("--port", type=int, default=PORT, help="port (default %(default)s)")
    options = parser.parse_args(arguments)
    print("Preparing the first picture (the first time half a minute) ...", flush=True)
    try:
        server = serve("" if options.everybody else "127.0.0.1", options.port)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    where = address_here() if options.everybody else "127.0.0.1"
    print(f"The bicycle wheel is at  http://{where}:{server.server_port}/", flush=True)
    print("Ctrl-C ends it.", flush=True)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print()
    finally:
        server.server_close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
