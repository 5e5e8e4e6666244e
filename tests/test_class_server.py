"""The server of a class: whatever a visitor sends, the others go on and he gets a sentence."""

import base64
import http.client
import json
import os
import re
import socket
import sys
import threading
import time

import numpy as np
import pytest
from kit import apart, classroom, guarded

from corridor.core.errors import InputError, WorkFailed

PAGE = classroom.PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def server():
    """The lesson's server without its first picture."""
    made = guarded.GuardedServer(("127.0.0.1", 0), classroom.Lesson)
    threading.Thread(target=made.serve_forever, args=(0.05,), daemon=True).start()
    yield made
    made.shutdown()
    made.server_close()


@pytest.fixture
def silent(capfd):
    """Nothing is printed on the teacher's screen."""
    yield
    said = capfd.readouterr()
    assert not said.err and not said.out


def asked(server, method="GET", path="/", body=None, host=None, **headers):
    """Status, headers and content of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    if host:
        headers["Host"] = host
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    out = answer.status, answer.headers, answer.read()
    connection.close()
    return out


def raw(server, sent, wait=20.0):
    """All that comes for some bytes until the server closes, and the seconds it took."""
    began, got = time.monotonic(), b""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=wait) as one:
        one.sendall(sent)
        while part := one.recv(65536):
            got += part
    return got, time.monotonic() - began


class TestWhatIsSent:
    @pytest.mark.parametrize(
        ("length", "status", "said"),
        [
            ("-1", 400, "not a whole number"),
            ("abc", 400, "not a whole number"),
            ("1e3", 400, "not a whole number"),
            ("\u00b2", 400, "not a whole number"),
            ("9" * 30, 413, "too large: together at most 30 MB"),
            (str(classroom.MOST_BYTES + 1), 413, "too large: together at most 30 MB"),
        ],
    )
    def test_a_length_that_cannot_be_is_refused_unread(self, server, length, status, said, silent):
        head = f"POST /own HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: {length}\r\n"
        head += "Connection: close\r\n\r\n"
        got = b""
        with socket.create_connection(("127.0.0.1", server.server_port), timeout=20) as one:
            one.sendall(head.encode("latin-1"))
            # An answer may come in pieces.
            while said.encode() not in got and (part := one.recv(65536)):
                got += part
        assert got.startswith(f"HTTP/1.1 {status} ".encode()) and said in got.decode()

    def test_no_length_and_chunks_are_refused(self, server, silent):
        for head in ("", "Transfer-Encoding: chunked\r\nContent-Length: 3\r\n"):
            sent = f"POST /own HTTP/1.1\r\nHost: localhost\r\n{head}\r\n{{ }}"
            got, _ = raw(server, sent.encode())
            assert got.startswith(b"HTTP/1.1 411 ")

    def test_a_body_that_is_too_large_gets_its_sentence_though_it_is_sent_whole(self, server):
        """The answer would be lost were the connection closed while the browser still sends."""
        status, _, content = asked(server, "POST", "/own", bytes(classroom.MOST_BYTES + 1))
        assert status == 413 and "at most 30 MB" in json.loads(content)["said"]

    @pytest.mark.parametrize(
        "body",
        [
            b"[" * 200_000,
            b'{"a":' * 200_000,
            b"",
            b"\xff\xfe",
            b"null",
            b"7",
            b"[]",
            b'{"still": 5}',
            b'{"still": [1]}',
            b'{"still": {"data": 5}}',
            b'{"still": {"data": "\xc3\xa4"}}',
            b'{"turning": "x"}',
            b'{"turns": [1]}',
            b'{"sense": ["cw"], "turns": "1"}',
            b'{"sense": "up", "turns": "1"}',
            b'{"turns": ' + b"9" * 5000 + b"}",
        ],
        ids=range(16),
    )
    def test_a_body_that_is_not_the_pages_is_a_sentence(self, body):
        with pytest.raises(InputError, match="did not come from our page: load it anew"):
            classroom.own(body)

    @pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
    def test_a_picture_beyond_fifty_million_pixels_is_refused_before_it_is_decoded(self):
        """A PNG of one grey: 60 kB that would be 150 MB."""
        packed = base64.b64encode(grey_png(10_000, 6_000)).decode()
        one = {"name": "s.png", "data": packed}
        body = json.dumps({"still": one, "turning": one, "turns": "1"}).encode()
        assert len(body) < 300_000
        said = classroom.own(body)["said"]
        assert re.search(r"s\.png .*10000 x 6000 pixels are more than the 50 million", said)


def grey_png(width, height):
    import cv2

    return cv2.imencode(".png", np.zeros((height, width), np.uint8))[1].tobytes()


class TestTime:
    def test_half_a_head_and_half_a_body_are_ended(self, server, monkeypatch, silent):
        monkeypatch.setattr(guarded, "HEAD_S", 0.5)
        monkeypatch.setattr(guarded, "BODY_S", 0.5)
        got, took = raw(server, b"GET / HT")
        assert b"wheel" not in got and took < 10
        head = b"POST /own HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{"
        got, took = raw(server, head)
        assert b"408" in got.split(b"\r\n")[0] and b"Not all arrived" in got and took < 10

    def test_who_sends_a_byte_now_and_then_is_ended_as_well(self, server, monkeypatch):
        monkeypatch.setattr(guarded, "HEAD_S", 0.6)
        with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as one:
            began = time.monotonic()
            with pytest.raises(OSError):
                while time.monotonic() - began < 8:
                    one.sendall(b"G")
                    time.sleep(0.1)
            assert time.monotonic() - began < 8


class TestAtOnce:
    def test_one_visitor_has_so_many_connections_and_gets_them_back(self, server, monkeypatch):
        monkeypatch.setattr(guarded, "MOST_OF_ONE", 3)
        held = [
            socket.create_connection(("127.0.0.1", server.server_port), timeout=10)
            for _ in range(3)
        ]
        until = time.monotonic() + 10
        while server._visitors.total() < 3 and time.monotonic() < until:
            time.sleep(0.01)
        got = b""
        try:
            got, _ = raw(server, b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        except ConnectionError:
            pass
        assert got == b""
        for one in held:
            one.close()
        while server._visitors.total() and time.monotonic() < until:
            time.sleep(0.01)
        assert asked(server)[0] == 200

    def test_a_further_upload_is_told_to_wait(self, server, monkeypatch):
        monkeypatch.setattr(classroom, "_uploads", threading.BoundedSemaphore(1))
        classroom._uploads.acquire()
        status, _, content = asked(server, "POST", "/own", b"{}")
        assert (status, json.loads(content)["said"]) == (503, classroom._BUSY)


class TestWhoAsks:
    @pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "[", "", "a b"])
    def test_a_name_that_is_not_ours_is_not_answered(self, server, host):
        head = f"GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        got, _ = raw(server, head.encode())
        assert got.startswith(b"HTTP/1.1 421 ") and b"the teacher's computer shows" in got

    @pytest.mark.parametrize("host", ["localhost", "127.0.0.1:80", "[::1]:9", "192.168.1.7:8866"])
    def test_numbers_and_this_machine_are(self, server, host):
        assert asked(server, host=host)[0] == 200
        assert asked(server, host=socket.gethostname())[0] == 200

    def test_another_page_cannot_send_for_its_visitor(self, server):
        status, *_ = asked(server, "POST", "/own", b"{}", Origin="https://evil.example")
        assert status == 403


class TestHeaders:
    @pytest.mark.parametrize(("method", "path"), [("GET", "/"), ("GET", "/x"), ("PUT", "/")])
    def test_every_answer_has_them(self, server, method, path):
        _, headers, _ = asked(server, method, path)
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "Python" not in headers["Server"]

    def test_the_policy_lets_the_pages_own_script_run_and_no_other(self):
        policy = classroom.Lesson.policy
        assert policy.count("'sha256-") == 2 and "unsafe" not in policy
        assert len(re.findall(r"<script", PAGE)) == 1 and len(re.findall(r"<style", PAGE)) == 1
        assert not re.search(r"<[^>]+\son\w+=|<[^>]+\sstyle=", PAGE)

    def test_the_page_says_the_limit_of_the_server(self):
        assert f"> {classroom.MOST_FILES / 1e6:.0f}e6)" in PAGE


# --- the process apart ---------------------------------------------------------------------------


def misbehave(how):
    """Work that goes wrong in every way."""
    if how == "sleep":
        time.sleep(60)
    if how == "die":
        os._exit(3)
    if how == "grow":
        return len(bytearray(3_000_000_000))
    if how == "input":
        raise InputError("it is wrong")
    if how == "fault":
        raise RecursionError
    return how


def test_work_apart_ends_in_a_sentence_and_the_next_piece_is_done():
    work = apart.Apart(misbehave, seconds=1.0, megabytes=500)
    try:
        assert work("well") == "well"
        with pytest.raises(InputError, match="^it is wrong$"):
            work("input")
        with pytest.raises(InputError, match="cannot be measured"):
            work("fault")
        if sys.platform == "linux":
            with pytest.raises(WorkFailed, match="more than the 500 MB"):
                work("grow")
        first = work._process.pid
        with pytest.raises(WorkFailed, match="longer than 1 s"):
            work("sleep")
        with pytest.raises(WorkFailed, match="or the file is damaged"):
            work("die")
        assert work("well") == "well" and work._process.pid != first
    finally:
        work.close()


def test_work_apart_begins_again_after_a_process_could_not_be_started(monkeypatch):
    """A whole class at once: no memory for a process now does not mean none later."""
    context = apart.multiprocessing.get_context("spawn").Process

    def refused(_):
        raise OSError(12, "Cannot allocate memory")

    work = apart.Apart(misbehave, seconds=1.0, megabytes=500)
    try:
        with monkeypatch.context() as patched:
            patched.setattr(context, "start", refused)
            for _ in range(2):
                with pytest.raises(WorkFailed, match="too busy to measure"):
                    work("well")
        assert work("well") == "well"
    finally:
        work.close()


# --- addresses -----------------------------------------------------------------------------------


def test_the_address_of_a_card_comes_before_that_of_a_tunnel(monkeypatch):
    cards = [("lo", "127.0.0.1"), ("wg0", "10.9.0.2"), ("wlan0", "192.168.4.7")]
    monkeypatch.setattr(guarded, "_cards", lambda: cards)
    monkeypatch.setattr(guarded, "_route", lambda: "10.9.0.2")
    monkeypatch.setattr(socket, "getaddrinfo", lambda *a: [])
    assert guarded.addresses() == ["192.168.4.7", "10.9.0.2"]


def test_among_cards_the_way_to_the_world_comes_first(monkeypatch):
    cards = [("eth0", "10.0.0.5"), ("wlan0", "192.168.4.7")]
    monkeypatch.setattr(guarded, "_cards", lambda: cards)
    monkeypatch.setattr(guarded, "_route", lambda: "192.168.4.7")
    monkeypatch.setattr(socket, "getaddrinfo", lambda *a: [])
    assert guarded.addresses() == ["192.168.4.7", "10.0.0.5"]
