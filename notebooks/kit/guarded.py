"""A small web server for a room full of people: limits on connections, time and bytes, and headers.

Nothing is secret here and nothing is kept; what strangers send must only not cost the lesson.
"""

from __future__ import annotations

import ipaddress
import socket
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

# A class of thirty, six connections a browser, behind one address where a router translates them;
# and room for as many besides.
MOST_OF_ONE, MOST_AT_ONCE = 200, 400
# A request without its body is some hundred bytes; a body of 40 MB passes a school's network at
# 0.5 MB/s. An answer that nobody fetches is given up with the first.
HEAD_S, BODY_S = 20.0, 90.0
# Network interfaces in which no pupil is: tunnels, and networks of virtual machines.
_ELSEWHERE = (
    "lo", "tun", "tap", "utun", "wg", "ppp", "tailscale", "zt", "docker", "br-", "veth", "virbr",
    "vmnet", "vboxnet", "cni", "podman",
)  # fmt: skip


class Refused(Exception):
    """A request that is not answered: a status, and a sentence for the person who asked."""

    def __init__(self, status: HTTPStatus, sentence: str):
        super().__init__(sentence)
        self.status = status


class GuardedServer(ThreadingHTTPServer):
    """Threads of one request each, so many at once and so many of one visitor."""

    daemon_threads = True
    # A class opens the page at once.
    request_queue_size = 128

    def __init__(self, address, handler):
        self._visitors: Counter[str] = Counter()
        self._until: dict[socket.socket, float] = {}
        self._turn = threading.Lock()
        super().__init__(address, handler)

    def process_request(self, request, client_address):
        """A thread for a connection, if there is room for it."""
        visitor = client_address[0]
        with self._turn:
            room = self._visitors.total() < MOST_AT_ONCE and self._visitors[visitor] < MOST_OF_ONE
            self._visitors[visitor] += room
        if room:
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request, client_address):
        """One connection, from its beginning to its end."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            with self._turn:
                self._visitors[client_address[0]] -= 1
                self._until.pop(request, None)
                if not self._visitors[client_address[0]]:
                    del self._visitors[client_address[0]]

    def patience(self, request: socket.socket, seconds: float | None) -> None:
        """What is being received must be there after so many seconds; None: nothing is."""
        with self._turn:
            if seconds is None:
                self._until.pop(request, None)
            else:
                self._until[request] = time.monotonic() + seconds

    def service_actions(self):
        """Ends connections that were given time enough (called twice a second)."""
        now = time.monotonic()
        with self._turn:
            for request, until in list(self._until.items()):
                if now > until:
                    del self._until[request]
                    with suppress(OSError):
                        request.shutdown(socket.SHUT_RD)  # what is missing may still be said

    def handle_error(self, request, client_address):
        """One line for what should not happen; nothing for a visitor who has gone."""
        error = sys.exc_info()[1]
        if not isinstance(error, (OSError, ValueError)):  # ValueError: the connection was ended
            print(f"a request was not answered ({type(error).__name__})", file=sys.stderr)


class GuardedHandler(BaseHTTPRequestHandler):
    """Requests with a head and a body of limited size and time, answers with guarding headers.

    A subclass answers in `do_GET` and `do_POST`, which begin with `self.admit()`.
    """

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "lesson", ""
    timeout = HEAD_S
    # What a page may load, as its Content-Security-Policy says.
    policy = "default-src 'none'"

    def handle_one_request(self):
        """One request of a connection, its head within HEAD_S."""
        self.server.patience(self.connection, HEAD_S)
        super().handle_one_request()
        self.server.patience(self.connection, None)

    def admit(self) -> None:
        """Raises Refused for a request by a name that is not ours, or from another page."""
        self.server.patience(self.connection, None)
        host = self.headers.get("Host", "")
        if not _is_ours(host):
            raise Refused(
                HTTPStatus.MISDIRECTED_REQUEST,
                "Open the page by the address that the teacher's computer shows.",
            )
        origin = self.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            raise Refused(HTTPStatus.FORBIDDEN, "This was sent from another page: open ours.")

    def length(self, most: int, larger: str) -> int:
        """Bytes of the body. Raises Refused where that is not said, or beyond `most` (`larger`)."""
        said = self.headers.get("Content-Length", "")
        if "Transfer-Encoding" in self.headers or not said:
            raise Refused(HTTPStatus.LENGTH_REQUIRED, "The length of what was sent is not said.")
        if not (said.isascii() and said.isdecimal()):
            raise Refused(
                HTTPStatus.BAD_REQUEST, "The length of what was sent is not a whole number."
            )
        if len(said) > 15 or int(said) > most:
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, larger)
        return int(said)

    def body(self, length: int) -> bytes:
        """The body, within BODY_S. Raises Refused where it ends early."""
        self.server.patience(self.connection, BODY_S)
        try:
            content = self.rfile.read(length)
        except OSError:
            content = b""
        self.server.patience(self.connection, None)
        if len(content) < length:
            raise Refused(
                HTTPStatus.REQUEST_TIMEOUT,
                "Not all arrived: try again, nearer to the access point.",
            )
        return content

    def pass_over(self) -> None:
        """Receive, for a while, what will not be read: else the answer does not get through."""
        self.close_connection = True
        self.server.patience(self.connection, HEAD_S)
        left, until = self.headers.get("Content-Length", ""), time.monotonic() + HEAD_S / 2
        left = int(left) if left.isascii() and left.isdecimal() and len(left) < 16 else 0
        with suppress(OSError):
            while left > 0 and time.monotonic() < until:
                read = len(self.rfile.read1(min(left, 1 << 16)))
                left = left - read if read else 0

    def answer(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        """Send an answer."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def end_headers(self):
        """The headers of every answer, errors included."""
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Content-Security-Policy", self.policy)
        super().end_headers()

    def log_message(self, *_):
        """Nothing: a class asks for thousands of pictures."""


def _is_ours(host: str) -> bool:
    """Whether a Host is a number, or a name of this machine: other names can be made to lead here.

    A page of a stranger whose name leads to this address would else read our answers (DNS
    rebinding).
    """
    try:
        name = urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return False
    own = socket.gethostname().lower()
    if name in ("localhost", own, f"{own}.local"):
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def addresses() -> list[str]:
    """IPv4 addresses of this machine that others may reach, the likeliest first; nothing is sent.

    A network card comes before a tunnel or a virtual network, and among cards the one by which the
    machine reaches the world.
    """
    default = _route()
    cards = {address: name for name, address in _cards()}
    with suppress(OSError):
        for *_, (address, _) in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET):
            cards.setdefault(address, "")
    if default:
        cards.setdefault(default, "")
    found = [
        one
        for one in cards
        if not ipaddress.ip_address(one).is_loopback
        and not ipaddress.ip_address(one).is_unspecified
    ]
    return sorted(found, key=lambda one: (cards[one].startswith(_ELSEWHERE), one != default))


def _route() -> str:
    """The address of this machine on the way to the world, "" without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return probe.getsockname()[0]
        except OSError:
            return ""


def _cards() -> list[tuple[str, str]]:
    """Names and addresses of network interfaces; on systems other than Linux, none."""
    if sys.platform != "linux":
        return []
    import fcntl

    out, get_address = [], 0x8915  # SIOCGIFADDR of linux/sockios.h
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            with suppress(OSError):
                asked = name.encode()[:15].ljust(40, b"\0")
                said = fcntl.ioctl(probe.fileno(), get_address, asked)
                out.append((name, socket.inet_ntoa(said[20:24])))
    return out
