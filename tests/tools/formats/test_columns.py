"""Numbers read as whole columns are those read line by line; what is odd is left to the lines."""

import io

import numpy as np
import pyarrow as pa
import pytest

from corridor.tools.formats import columns as module
from corridor.tools.formats import read_project
from corridor.tools.formats.columns import (
    grouped,
    in_groups,
    in_parts,
    in_rows,
    numbered,
    plain_numbers,
    text_of_rows,
)

from .small_projects import write_all


@pytest.mark.parametrize("chunk", [5, 16, 1 << 22])
def test_numbers_and_their_lines_come_back_whatever_the_chunk(chunk, monkeypatch):
    monkeypatch.setattr(module, "_CHUNK", chunk)
    text = b"1 2.5 -3e2\n\n  07\t+8\r\n\n9"
    found = plain_numbers(io.BytesIO(text))
    assert found.values.tolist() == [1, 2.5, -300, 7, 8, 9]
    assert found.whole.tolist() == [True, False, False, True, False, True]
    assert found.counts.tolist() == [3, 2, 1]
    assert found.starts.tolist() == [0, 3, 5]
    assert (found.size, found.lines) == (len(text), 4)
    some = plain_numbers(io.BytesIO(text), 2)
    assert some.values.tolist() == [1, 2.5, -300, 7, 8]
    assert text[some.size :].split() == [b"9"]
    assert some.lines == text[: some.size].count(b"\n")


@pytest.mark.parametrize(
    "odd", [b"nan", b"inf", b"1e999", b"1,5", b"1_0", b"0x1", b"1-2", b"--1", b".", b"e", b"\0",
            b"\xef\xbb\xbf1", b"1\r2", b"# 1", b"1\x0b2", "１".encode()],
)  # fmt: skip
def test_anything_but_decimal_numbers_is_left_to_the_lines(odd):
    assert plain_numbers(io.BytesIO(b"1 2\n" + odd + b"\n3\n")) is None
    assert plain_numbers(io.BytesIO(b"1 2\n" + odd + b"\n3\n"), 1).values.tolist() == [1, 2]


def test_written_numbers_come_back_bit_for_bit():
    """17 digits at any size, as IEEE 754 needs."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=3000) * 10.0 ** rng.integers(-30, 30, 3000)
    text, starts = text_of_rows(in_rows(values), "\n")
    found = plain_numbers(io.BytesIO(text.to_pybytes()[: starts[-1]]))
    assert np.array_equal(found.values, values)


def test_rows_are_grouped_numbered_and_written_in_parts():
    codes = np.array([2, 0, 2, 2, 0])
    order, starts = grouped(codes, 4)
    assert order.tolist() == [1, 4, 0, 2, 3] and starts.tolist() == [0, 2, 2, 5, 5]
    assert numbered(codes).tolist() == [0, 0, 1, 2, 1]
    parts = [(part, at.tolist(), rows.tolist()) for part, at, rows in in_parts(order, starts, 3)]
    assert parts == [(slice(0, 3), [0, 2, 2, 5], [1, 4, 0, 2, 3]), (slice(3, 6), [0, 0], [])]
    words = in_rows(np.array([1, 2, 3, 4, 5]), np.array([0.5, 1.5, 2.5, 3.5, 4.5]))
    groups = in_groups(words.take(pa.array(order)), starts)
    assert groups.to_pylist() == ["2 1.5 5 4.5", "", "1 0.5 3 2.5 4 3.5", ""]
    text, ends = text_of_rows(groups, ";\n")
    assert text.to_pybytes()[: ends[-1]] == b"2 1.5 5 4.5;\n;\n1 0.5 3 2.5 4 3.5;\n;\n"


TEXTS = ("colmap-text", "micmac", "bundler", "nvm", "bal")


@pytest.fixture(scope="module")
def projects(tmp_path_factory):
    return write_all(tmp_path_factory.mktemp("projects"))


def read_by_line(path, monkeypatch):
    with monkeypatch.context() as patch:
        for name in ("columns", "programs.micmac", "programs.colmap.records"):
            patch.setattr(f"corridor.tools.formats.{name}.plain_numbers", lambda *_: None)
        return read_project(path).block


@pytest.mark.parametrize("form", TEXTS)
def test_columns_and_lines_read_the_same_block(form, projects, monkeypatch):
    at_once, by_line = read_project(projects[form]).block, read_by_line(projects[form], monkeypatch)
    for table in ("images", "tie_points", "points", "marks"):
        assert getattr(at_once, table).equals(getattr(by_line, table))


def test_whole_files_do_not_go_through_the_loop_over_lines(tmp_path, monkeypatch):
    """Nobody notices a fast path that is never taken: the loop must not be reached."""
    paths = write_all(tmp_path)

    def never(*_):
        raise AssertionError("read line by line")

    monkeypatch.setattr("corridor.tools.formats.columns._by_line", never)
    for form in TEXTS:
        assert len(read_project(paths[form]).block.tie_points)
