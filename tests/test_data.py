"""Fetching data: from a server of this machine, whole and checked, or not at all."""

import hashlib
import http.server
import shutil
import socket
import threading
from dataclasses import replace

import pytest

import corridor
from corridor.core.errors import FetchFailed, InputError
from corridor.tools import data


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


class _Half(_Quiet):
    """Says that a file is longer than what it sends."""

    def do_GET(self):
        self.send_response(200)
        self.send_header("Content-Length", "100000")
        self.end_headers()
        self.wfile.write(b"half a download")


@pytest.fixture
def serve():
    """An address of this machine that serves a folder."""
    servers = []

    def started(folder, handler=_Quiet):
        def made(*arguments, **named):
            return handler(*arguments, directory=str(folder), **named)

        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), made)
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield started
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.fixture
def bundler(real_data, tmp_path):
    """A folder with the file of `balbianello` under the name of the register."""
    folder = tmp_path / "served"
    folder.mkdir()
    shutil.copy(
        real_data / "interchange/bundler_balbianello/Balbianello.out", folder / "Balbianello.out"
    )
    return folder


def refused(name, out, mirror):
    with pytest.raises(FetchFailed) as reason:
        data.fetch(name, out, mirror)
    assert not out.exists() and not list(out.parent.glob(".*"))
    return str(reason.value)


def test_the_shipped_block_is_fetched_whole(tmp_path):
    data.fetch("dike", tmp_path / "dike")
    assert len(corridor.read(tmp_path / "dike").images) == 42
    data.fetch("dike", tmp_path / "dike")  # its own folder it may replace
    with pytest.raises(InputError, match="did you mean dike"):
        data.fetch("dyke", tmp_path / "other")


def test_a_public_set_is_fetched_checked_and_converted(bundler, serve, tmp_path):
    told = data.fetch("balbianello", tmp_path / "out", serve(bundler))
    assert "5 images, 0.42 px as known" in told[-1]
    assert len(corridor.read(tmp_path / "out" / "block").images) == 5
    assert "licence: BSD" in (tmp_path / "out" / "SOURCE.txt").read_text()


def test_another_file_is_refused_by_its_hash(bundler, serve, tmp_path):
    path = bundler / "Balbianello.out"
    path.write_text(path.read_text().replace("5 544", "5 543", 1))
    assert "SHA-256" in refused("balbianello", tmp_path / "out", serve(bundler))


def test_a_file_that_is_not_there_and_half_a_download_leave_nothing(serve, tmp_path):
    empty = tmp_path / "served"
    empty.mkdir()
    assert "status 404" in refused("balbianello", tmp_path / "out", serve(empty))
    assert "Balbianello.out" in refused("balbianello", tmp_path / "out", serve(empty, _Half))


def test_no_network_is_one_sentence(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        nobody = f"http://127.0.0.1:{free.getsockname()[1]}"
    said = refused("balbianello", tmp_path / "out", nobody)
    assert "cannot be fetched" in said and "--mirror" in said and "\n" not in said


def test_other_photographs_are_refused_by_what_they_say(real_data, serve, tmp_path, monkeypatch):
    """No hash is known of them: the model of the camera and their number are."""
    one = data.register()["brighton"]
    names = list(one.files)[:2]
    few = replace(
        one,
        files={name: (name, "") for name in names},
        address=serve(real_data / "brighton" / "photos"),
        known={"model": "FC300S", "photographs": 2},
    )
    monkeypatch.setitem(data.register(), "brighton", few)
    said = data.fetch("brighton", tmp_path / "good")[-1]
    assert said.startswith("not verified") and "2 photographs of a FC300S" in said
    kept = (tmp_path / "good" / "SOURCE.txt").read_text()
    picture = (tmp_path / "good" / names[0]).read_bytes()
    assert f"sha256: {hashlib.sha256(picture).hexdigest()} {names[0]}\n" in kept
    wrong = replace(few, known={"model": "FC330", "photographs": 2})
    monkeypatch.setitem(data.register(), "brighton", wrong)
    assert "FC300S, known is FC330" in refused("brighton", tmp_path / "out", None)


def test_what_cannot_be_verified_is_not_taken_from_a_mirror(tmp_path):
    assert not data.register()["brighton"].verified and data.register()["led"].verified
    with pytest.raises(InputError, match="no hash of the files of brighton is known"):
        data.fetch("brighton", tmp_path / "out", "http://127.0.0.1:1")


def test_a_second_fetch_replaces_its_files_and_no_others(tmp_path):
    data.fetch("dike", tmp_path / "dike")
    (tmp_path / "dike" / "mine.txt").write_text("keep me")
    data.fetch("wall", tmp_path / "dike")
    left = {path.name for path in (tmp_path / "dike").iterdir()}
    assert {"mine.txt", "series.csv"} <= left and "block.toml" not in left


def test_every_set_says_whose_it_is_and_what_one_may_do():
    for one in data.register().values():
        assert one.about and one.source and one.licence
        assert one.kind == "shipped" or (one.files and one.address.startswith("https://"))
    assert len(data.table()) == len(data.register())


def test_the_track_is_fetched_and_read(real_data, serve, tmp_path):
    import gzip

    folder = tmp_path / "served"
    folder.mkdir()
    source = real_data / "m300_ppk"
    track = gzip.decompress((source / "grafnav_5hz.txt.gz").read_bytes())
    (folder / "PPK_5Hz.txt").write_bytes(track)
    shutil.copy(source / "timestamp.MRK", folder / "Timestamp.MRK")
    shutil.copy(source / "published_camera_positions.csv", folder / "PrecGeoTag_PPK.csv")
    assert "18,602 epochs" in data.fetch("m300_ppk", tmp_path / "out", serve(folder))[-1]


def test_a_photograph_of_a_led_is_fetched_and_measured(real_data, serve, tmp_path):
    folder = tmp_path / "served"
    folder.mkdir()
    shutil.copy(real_data / "wheel_bar" / "led_1khz.png", folder / "frame_example.png")
    assert "known are 15.73 ms" in data.fetch("led", tmp_path / "out", serve(folder))[-1]
