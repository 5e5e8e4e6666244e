"""What the fuzzer of readers makes of an input, without the fuzzer."""

import pytest

from benchmarks.guarantees import fuzz


def test_a_folder_is_an_input_and_back(tmp_path):
    (tmp_path / "in" / "deep").mkdir(parents=True)
    (tmp_path / "in" / "a.txt").write_bytes(b"1 2\n\x00")
    (tmp_path / "in" / "deep" / "b.bin").write_bytes(bytes(range(256)))
    made = fuzz.unpacked(fuzz.packed(tmp_path / "in"), tmp_path / "out")
    for name in ("a.txt", "deep/b.bin"):
        assert (made / name).read_bytes() == (tmp_path / "in" / name).read_bytes()
    one = fuzz.unpacked(fuzz.packed(tmp_path / "in" / "a.txt"), tmp_path / "one")
    assert one.name == "a.txt" and one.read_bytes() == b"1 2\n\x00"


@pytest.mark.parametrize("name", [b"../../out", b"/etc/x", b"..\\..\\x", b"\0", b"", b"a/../../b"])
def test_no_input_leaves_its_folder(tmp_path, name):
    fuzz.unpacked(fuzz._NEXT + name + fuzz._IN + b"x", tmp_path / "in")
    assert {path.name for path in tmp_path.iterdir()} <= {"in"}


def test_every_format_joins_by_itself():
    from corridor.tools.formats.programs import formats

    assert set(formats()) < set(fuzz.readers())


def test_a_refusal_is_no_fault_and_anything_else_is():
    from corridor.core.errors import InputError

    def refuses(path):
        raise InputError("no")

    def falls(path):
        raise KeyError("x")

    assert not fuzz.judged(refuses, b"") and not fuzz.judged(str, b"")
    assert "KeyError" in fuzz.judged(falls, b"")
