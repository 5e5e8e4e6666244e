"""Files and folders appear whole or not at all, also where two runs write the same ones."""

import csv
import json
import multiprocessing
import sys
import threading
from contextlib import contextmanager

import pandas as pd
import pytest
from made_up import adjustment, corridor
from matplotlib.figure import Figure

from corridor import InputError
from corridor.core.output import (
    as_it_was,
    check_folder,
    file_lines,
    listed_in,
    whole_file,
    whole_files,
    whole_folder,
    write_csv,
    write_json,
)
from corridor.core.output.files import _alone_in, harmless
from corridor.interface.report import save_adjustment

SIZE = 40


def write_again_and_again(folder, word, rounds, start):
    """Writes a folder of two files that belong together, and a file beside it."""
    start.wait()
    for _ in range(rounds):
        with whole_folder(folder, "result.json", listed_in(folder, "result.json")) as part:
            (part / f"only_{word}.txt").write_text(word * SIZE)
            (part / "both.txt").write_text(word * SIZE)
            write_json(
                {"by": word, "files": [f"only_{word}.txt", "both.txt"]}, part / "result.json"
            )
        with whole_file(folder.parent / "beside.txt") as part:
            part.write_text(word * SIZE)


def two(kind, *words_arguments):
    made = [kind(target=write_again_and_again, args=arguments) for arguments in words_arguments]
    for one in made:
        one.start()
    for one in made:
        one.join(60)
    return made


def holds_one_run_whole(folder):
    by = json.loads((folder / "result.json").read_text())["by"]
    assert {path.name for path in folder.iterdir()} == {
        "result.json", "both.txt", f"only_{by}.txt", "notes.txt",
    }  # fmt: skip
    assert (folder / "both.txt").read_text() == (folder / f"only_{by}.txt").read_text() == by * SIZE
    assert (folder.parent / "beside.txt").read_text() in ("a" * SIZE, "b" * SIZE)
    assert {path.name for path in folder.parent.iterdir()} == {folder.name, "beside.txt"}


@pytest.fixture
def folder(tmp_path):
    """A folder with an earlier result and a file of the user's."""
    out = tmp_path / "out"
    with whole_folder(out, "result.json") as part:
        (part / "result.json").write_text('{"by": "nobody", "files": []}')
    (out / "notes.txt").write_text("keep me")
    return out


@pytest.mark.slow
def test_two_processes_into_one_folder_leave_the_last_one_whole_and_nothing_else(folder):
    context = multiprocessing.get_context("spawn")
    start = context.Barrier(2)
    made = two(context.Process, *((folder, word, 50, start) for word in "ab"))
    assert [one.exitcode for one in made] == [0, 0]
    holds_one_run_whole(folder)


def test_two_threads_into_one_folder_leave_the_last_one_whole_and_nothing_else(folder):
    failed = []
    threading.excepthook, before = lambda call: failed.append(call), threading.excepthook
    try:
        start = threading.Barrier(2)
        two(threading.Thread, *((folder, word, 50, start) for word in "ab"))
    finally:
        threading.excepthook = before
    assert not failed
    holds_one_run_whole(folder)


def test_what_was_replaced_goes_though_another_run_takes_the_folder_away_at_once(
    folder, monkeypatch
):
    taken = folder.with_name("taken by another run")

    @contextmanager
    def followed_by_another(parent):
        with _alone_in(parent):
            yield
        if (folder / "new.txt").exists():
            folder.rename(taken)

    monkeypatch.setattr("corridor.core.output.files._alone_in", followed_by_another)
    with whole_folder(folder, "result.json", listed_in(folder, "result.json")) as part:
        (part / "new.txt").write_text("ours")
    assert {path.name for path in folder.parent.iterdir()} == {taken.name}
    assert (taken / "notes.txt").read_text() == "keep me"


@pytest.mark.parametrize("system", ["locks folders", "has no fcntl"])
def test_who_replaces_something_waits_until_another_is_done(tmp_path, system, monkeypatch):
    """Windows has no fcntl."""
    if system == "has no fcntl":
        monkeypatch.setitem(sys.modules, "fcntl", None)
    replaced = threading.Event()

    def replace():
        with whole_file(tmp_path / "out.txt") as part:
            part.write_text("whole")
        replaced.set()

    other = threading.Thread(target=replace)
    with _alone_in(tmp_path):
        other.start()
        assert not replaced.wait(0.2)
    assert replaced.wait(10)
    other.join()
    assert [path.name for path in tmp_path.iterdir()] == ["out.txt"]


def test_what_another_run_wrote_meanwhile_goes_with_it(tmp_path):
    """The run that began first and ends last knows nothing of the table of the other one."""
    block, out = corridor(images=8), tmp_path / "out"
    many = [("focal", "f", f"DJI_{k:04d}.JPG", 0.1 * k, 0.05, "px") for k in range(60)]

    class Slow(Figure):
        def draw(self, renderer):
            save_adjustment(adjustment(block, effects=many), out)
            super().draw(renderer)

    save_adjustment(adjustment(block), out)
    save_adjustment(adjustment(block), out, {"slow": Slow()})
    assert (out / "slow.png").is_file() and not (out / "effect_focal.csv").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_file_that_two_write_at_once_is_that_of_the_last(tmp_path):
    with whole_file(tmp_path / "table.csv") as first:
        first.write_text("first")
        with whole_file(tmp_path / "table.csv") as second:
            second.write_text("second")
        assert (tmp_path / "table.csv").read_text() == "second"
    assert (tmp_path / "table.csv").read_text() == "first"
    assert len(list(tmp_path.iterdir())) == 1


def test_files_that_belong_together_appear_together_or_not_at_all(tmp_path):
    table, picture = tmp_path / "new" / "table.csv", tmp_path / "new" / "table.png"
    with pytest.raises(KeyboardInterrupt), whole_files(picture, table) as parts:
        parts[0].write_text("drawn")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
    with whole_files(picture, table) as parts:
        for part in parts:
            part.write_text(part.name)
        assert not table.exists() and not picture.exists()
    assert {path.name for path in table.parent.iterdir()} == {"table.csv", "table.png"}


def test_a_folder_of_something_else_is_refused_before_the_work(tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(InputError, match=r"without result\.json"):
        check_folder(tmp_path, "result.json")
    with pytest.raises(InputError, match="is a file"):
        check_folder(tmp_path / "thesis.tex", "result.json")


def made(out, *names):
    """A result that lists its files, in `out`."""
    with whole_folder(out, "result.json") as part:
        for name in names:
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            (part / name).write_text("ours")
        (part / "result.json").write_text(json.dumps({"files": list(names)}))


class TestWhatIsSomebodyElses:
    def test_stays_in_folders_of_ours_as_well(self, tmp_path):
        out = tmp_path / "out"
        made(out, "block/images.csv", "block/old.csv", "gone/a.csv")
        for name in ("block/notes.txt", "block/deep/er/notes.txt", "gone/notes.txt", "notes.txt"):
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            (out / name).write_text("keep me")
        (out / "block" / "empty").mkdir()
        (out / "block" / "link").symlink_to("notes.txt")
        made(out, "block/images.csv", "block/new.csv")
        left = {p.relative_to(out).as_posix() for p in out.rglob("*") if not p.is_dir()}
        assert left == {
            "result.json", "block/images.csv", "block/new.csv", "block/notes.txt",
            "block/deep/er/notes.txt", "block/link", "gone/notes.txt", "notes.txt",
        }  # fmt: skip
        assert (out / "block" / "empty").is_dir() and (out / "block" / "link").is_symlink()
        assert (out / "block" / "deep" / "er" / "notes.txt").read_text() == "keep me"

    def test_stays_where_the_earlier_result_lists_nothing(self, tmp_path):
        out = tmp_path / "out"
        made(out, "a.csv")
        for said in ("", "{}", "[", '{"files": 5}', "\u00e4"):
            (out / "result.json").write_text(said, encoding="utf-8")
            (out / "a.csv").write_text("perhaps mine")
            made(out, "b.csv")
            assert (out / "a.csv").read_text() == "perhaps mine"

    def test_a_text_may_list_the_files(self, tmp_path):
        for names in (("a.txt", "deep/b.txt"), ("c.txt",)):
            with whole_folder(tmp_path / "out", "made.txt") as part:
                for name in names:
                    (part / name).parent.mkdir(exist_ok=True)
                    (part / name).write_text("ours")
                (part / "made.txt").write_text(f"what it is\n{file_lines(part)}")
            (tmp_path / "out" / "notes.txt").write_text("mine")
        left = {path.name for path in (tmp_path / "out").iterdir()}
        assert left == {"c.txt", "made.txt", "notes.txt"}

    def test_a_file_in_the_way_of_a_new_folder_ends_the_run_with_all_as_it_was(self, tmp_path):
        made(tmp_path / "out", "a.csv")
        (tmp_path / "out" / "block").write_text("mine")
        with pytest.raises(OSError):
            made(tmp_path / "out", "block/images.csv")
        assert (tmp_path / "out" / "block").read_text() == "mine"
        assert (tmp_path / "out" / "a.csv").read_text() == "ours"
        assert [path.name for path in tmp_path.iterdir()] == ["out"]


class TestWhatASpreadsheetWouldRun:
    @pytest.mark.parametrize(
        "name",
        ["=cmd|'/C calc'!A0", "+A1", "-A1+B2", "@SUM(A1)", "\t=A1", " =A1", "'=A1", "\uff1d1+1"],
    )
    def test_is_a_text_in_every_table_of_a_result(self, name, tmp_path):
        frame = pd.DataFrame({"point": ["a", name], name: ["b", name], "x": [1.5, -2.5]})
        frame["kind"] = frame["point"].astype("category")
        write_csv(frame, tmp_path / "t.csv")
        with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
            head, first, second = csv.reader(file)
        assert as_it_was(f"'{name}") == name == as_it_was(harmless(name))
        assert head == ["point", f"'{name}", "x", "kind"] and first == ["a", "b", "1.5", "a"]
        assert second == [f"'{name}", f"'{name}", "-2.5", f"'{name}"]

    @pytest.mark.parametrize("name", ["a", "-12", "+7.5", "-1e5", "a=b", "", "G-1"])
    def test_is_no_number_and_no_ordinary_name(self, name, tmp_path):
        write_csv(pd.DataFrame({"point": [name]}), tmp_path / "t.csv")
        with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
            assert list(csv.reader(file))[1] == [name]
        assert as_it_was(name) == name

    def test_begins_no_row_of_its_own(self, tmp_path):
        write_csv(pd.DataFrame({"point": ["a\r=A1", "a\n=A1"]}), tmp_path / "t.csv")
        with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
            assert len(list(csv.reader(file))) == 3
