"""Faults in files of other programs: one sentence with the file, the place and the remedy."""

import bz2
import gzip
import io
import tracemalloc

import numpy as np
import pytest

from corridor.core import textfile
from corridor.core.errors import InputError
from corridor.core.textfile import Line, Xml, lines, number, read_lines
from corridor.tools.formats.columns import NumberLines
from corridor.tools.formats.textfile import Following, Json, filled
from corridor.tools.readout.lens import read_camera


def test_lines_of_any_encoding_and_ending_are_counted_from_one(tmp_path):
    for data in (b"a\r\n\nb\rc", "\ufeffa\n\nb\nc\n".encode(), "a\n\nb\nc".encode("utf-16")):
        (tmp_path / "x.txt").write_bytes(data)
        assert [(line.at, line.text) for line in filled(tmp_path / "x.txt")] == [
            (1, "a"), (3, "b"), (4, "c"),
        ]  # fmt: skip


def test_a_packed_file_is_read_and_a_damaged_one_refused(tmp_path):
    path = tmp_path / "x.bz2"
    path.write_bytes(bz2.compress(b"1 2\n3 4\n"))
    assert [line.text for line in lines(path)] == ["1 2", "3 4"]
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(InputError, match="x.bz2 cannot be read"):
        list(lines(path))


@pytest.mark.parametrize(
    "word, told",
    [("1,5", "has a decimal comma"), ("x", "is not a number"), ("nan", "is not a finite number"),
     ("1_0", "is not a finite number")],
)  # fmt: skip
def test_a_word_that_is_no_number_is_named_with_its_place(tmp_path, word, told):
    with pytest.raises(InputError, match=rf"x.txt, row 7: height = '{word}' {told}; "):
        number(word, tmp_path / "x.txt", 7, "height", count="row")
    with pytest.raises(InputError, match=rf"x.txt, line 7: height = '{word}' {told}; "):
        Line(tmp_path / "x.txt", 7, "").numbers(["1", word], "height")


def test_what_should_follow_is_told_where_the_file_ends(tmp_path):
    (tmp_path / "x.txt").write_text("# no\n1 2\n\n")
    source = Following(tmp_path / "x.txt", comment="#")
    assert source.values(2, "a pair").tolist() == [1.0, 2.0]
    with pytest.raises(InputError, match=r"x.txt, line 3: the file ends where point 2 should"):
        source.next("point 2")


def test_elements_and_members_are_named_where_lines_are_not_known(tmp_path):
    root = Xml.parse(b"<a><b>1 2</b><c x='q'/></a>", tmp_path / "x.xml")
    assert np.array_equal(root.values("b", 2), [1.0, 2.0])
    for read, told in (
        (lambda: root.values("b", 3), "x.xml: <b> holds 2 numbers where 3 belong"),
        (lambda: root.child("d"), "x.xml: <a> has no <d>"),
        (lambda: root.child("c").number("x"), "x.xml: x of <c> = 'q' is not a number"),
    ):
        with pytest.raises(InputError, match=told):
            read()
    (tmp_path / "x.json").write_text('{"shots": {"A": {"focal": true}}}')
    shot = Json.read(tmp_path / "x.json").objects("shots", "shot")["A"]
    with pytest.raises(InputError, match=r"x.json: shot 'A' has no number focal \(True\)"):
        shot.number("focal")


def grown(pack, megabytes=80):
    """What unpacks to so many megabytes of one letter."""
    out = io.BytesIO()
    with pack(out, "wb") as file:
        for _ in range(megabytes):
            file.write(b"7" * 1_000_000)
    return out.getvalue()


@pytest.mark.parametrize(
    ("name", "pack", "read"),
    [
        ("a.pos.gz", gzip.open, read_lines),
        ("a.txt.gz", gzip.open, lambda path: list(lines(path))),
        ("a.txt.bz2", bz2.open, lambda path: list(lines(path))),
        ("a.txt.bz2", bz2.open, lambda path: NumberLines(Following(path))),
    ],
)
def test_a_packed_file_that_grows_beyond_measure_is_refused_while_it_grows(
    tmp_path, name, pack, read
):
    path = tmp_path / name
    path.write_bytes(grown(pack))
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    with pytest.raises(InputError, match=f"{name} unpacks to more than 100 times its size"):
        read(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 300e6


def test_what_is_small_may_be_all_alike(tmp_path):
    path = tmp_path / "a.txt.gz"
    path.write_bytes(gzip.compress(b"1 2\n" * 1_000_000))
    assert len(read_lines(path)) == 1_000_000


def test_a_text_that_is_held_whole_has_an_end(tmp_path, monkeypatch):
    monkeypatch.setattr(textfile, "_MOST_HELD", 1000)
    monkeypatch.setattr(textfile, "_PIECE", 400)
    (tmp_path / "a.pos").write_text("1 2\n" * 300)
    with pytest.raises(InputError, match=r"a\.pos holds more than"):
        read_lines(tmp_path / "a.pos")


def test_a_damaged_packed_text_is_a_sentence(tmp_path):
    data = bytearray(gzip.compress(np.random.default_rng(1).bytes(5000)))
    data[100:140] = bytes(40)
    (tmp_path / "a.pos.gz").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.pos\.gz cannot be read"):
        read_lines(tmp_path / "a.pos.gz")


def test_settings_with_a_byte_order_mark_are_settings_and_what_is_none_is_told(tmp_path):
    """Editors of Windows write the mark; cameras, plans and conventions may come from there."""
    path = tmp_path / "camera.toml"
    table = "[camera.A]\nwidth = 100\nheight = 80\nf = 90.0\n"
    path.write_text(table, encoding="utf-8-sig")
    assert read_camera(path)["f"] == 90.0
    for content, told in ((b"[camera", "is not valid TOML"), (b"name = '\xff'", "is not UTF-8")):
        path.write_bytes(content)
        with pytest.raises(InputError, match=f"camera.toml {told}"):
            textfile.read_toml(path)
    with pytest.raises(InputError, match="none.toml cannot be read"):
        textfile.read_toml(tmp_path / "none.toml")
