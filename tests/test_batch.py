"""Many blocks: each as if it were alone, one table, and what is done stays done."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import LinearEffect, Parameter
from corridor.core.output import json_text, sole
from corridor.core.simulation import add_noise
from corridor.interface.cli import main
from corridor.tools.batch.work import limited

NOISE = dict(tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01)


def small(seed):
    block = corridor_block(images=9, strips=3, observations_per_image=60, seed=seed)
    return add_noise(block, **NOISE, seed=seed)


@pytest.fixture(scope="module")
def blocks(tmp_path_factory):
    """Three good blocks and one that cannot be read."""
    folder = tmp_path_factory.mktemp("blocks")
    for number, name in enumerate(("north", "south", "west")):
        small(number).write(folder / name)
    shutil.copytree(folder / "west", folder / "broken")
    (folder / "broken" / "images.csv").unlink()
    return folder


@pytest.fixture(scope="module")
def done(blocks, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "campaign"
    return corridor.batch("adjust", blocks, out, jobs=1, required=0.05), out


def contents(folder):
    """Bytes of every file of a result, without the time that it took."""
    out = {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    said = json.loads(out[Path("adjustment.json")])
    assert said.pop("seconds") > 0
    return out | {Path("adjustment.json"): json.dumps(said)}


def alone(block, out):
    """What `corridor adjust` makes of one block."""
    adjustment = corridor.adjust(block)
    adjustment.required = 0.05
    adjustment.save(out, corridor.figures.of_adjustment(adjustment))
    return contents(out)


def test_results_are_those_of_one_block_at_a_time_bit_for_bit(done, blocks, tmp_path):
    campaign, out = done
    assert contents(out / "blocks" / "south") == alone(blocks / "south", tmp_path / "south")
    row = campaign.table.set_index("block").loc["south"]
    rms = corridor.adjust(blocks / "south").check_rms
    assert row[["check_rms_xy_m", "check_rms_z_m", "check_rms_3d_m"]].tolist() == list(rms)


def test_a_block_that_fails_is_a_row_with_its_sentence_and_the_others_go_on(done, blocks):
    campaign, _ = done
    with pytest.raises(corridor.InputError) as told:
        corridor.read(blocks / "broken")
    # What needs attention first stands first.
    assert campaign.rows[0].block == "broken" and campaign.rows[0].attention == str(told.value)
    assert [row.verdict for row in campaign.rows[1:]] == ["good enough"] * 3
    errors = [row.check_rms_3d_m for row in campaign.rows[1:]]
    assert errors == sorted(errors, reverse=True)


def test_the_table_is_a_file_and_every_link_of_the_page_leads_to_a_report(done):
    campaign, out = done
    table = pd.read_csv(out / "batch.csv")
    pd.testing.assert_frame_equal(
        table[["block", "check_rms_3d_m"]], campaign.table[["block", "check_rms_3d_m"]]
    )
    page = (out / "report.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([^"]*)"', page)
    assert links == table["report"].dropna().tolist() and len(links) == 3
    assert all((out / link).is_file() for link in links)
    assert "4 blocks adjusted (50 mm are required): 1 failed, 3 good enough." in page
    assert str(campaign).startswith("4 blocks adjusted (50 mm are required): 1 failed, 3 good")


@pytest.fixture
def without_pictures(monkeypatch):
    """They take longer than the adjustments."""
    monkeypatch.setattr("corridor.interface.figures.of_adjustment", lambda _: {})


def when(out):
    return {path.parent.name: path.stat().st_mtime_ns for path in out.glob("blocks/*/report.html")}


def test_what_is_done_is_not_done_again_but_what_changed_or_went_is(
    done, blocks, tmp_path, without_pictures
):
    here, out, told = tmp_path / "blocks", tmp_path / "out", []
    shutil.copytree(blocks, here)
    shutil.copytree(done[1], out)
    block = corridor.read(here / "south")
    block.gnss["x"] += 0.01
    block.write(here / "south")
    small(9).write(here / "broken")
    shutil.rmtree(out / "blocks" / "west")
    before = when(out)
    campaign = corridor.batch(
        "adjust",
        here,
        out,
        jobs=1,
        required=0.05,
        progress=lambda step: told.append((step.result.block, step.done, step.of)),
    )
    # What is kept is told first.
    assert told[0] == ("north", 1, 4) and told[-1][1:] == (4, 4)
    after = when(out)
    assert [name for name in after if before.get(name) == after[name]] == ["north"]
    assert len(after) == 4 and not campaign.failed
    # Other options are another question.
    corridor.batch("adjust", here / "north", out, jobs=1, required=0.01)
    assert when(out)["north"] != before["north"]


def test_two_batches_into_one_folder_are_refused(done, blocks):
    _, out = done
    with sole(out / "batch.lock") as ours:
        assert ours
        with pytest.raises(corridor.InputError, match="another batch is writing there; wait"):
            corridor.batch("adjust", blocks, out, jobs=1)


@pytest.mark.parametrize("system", ["locks files", "has no fcntl"])
def test_a_lock_is_one_s_alone_and_leaves_nothing(tmp_path, system, monkeypatch):
    if system == "has no fcntl":
        monkeypatch.setitem(sys.modules, "fcntl", None)
    with sole(tmp_path / "lock") as first, sole(tmp_path / "lock") as second:
        assert (first, second) == (True, False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_a_lock_is_free_once_its_holder_was_killed(tmp_path):
    program = (
        "import pathlib, sys, time; from corridor.core.output import json_text, sole\n"
        "with sole(pathlib.Path(sys.argv[1])) as ours: print(ours, flush=True); time.sleep(60)"
    )
    command = [sys.executable, "-c", program, str(tmp_path / "lock")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "True\n"
        with sole(tmp_path / "lock") as ours:
            assert not ours
        holder.kill()
    with sole(tmp_path / "lock") as ours:
        assert ours


def test_blocks_of_one_name_are_told_apart_by_the_folders_above(blocks, tmp_path):
    for survey in ("spring", "autumn"):
        shutil.copytree(blocks / "broken", tmp_path / survey / "block")
    named = [tmp_path / "spring" / "block", tmp_path / "autumn" / "block"]
    campaign = corridor.batch("adjust", named, tmp_path / "out", jobs=1)
    assert [row.block for row in campaign.rows] == ["autumn-block", "spring-block"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux only")
def test_memory_beyond_the_limit_is_refused_by_the_system():
    with limited(8.0), pytest.raises(MemoryError):
        np.empty(10**10, dtype=np.uint8)
    np.empty(10**10, dtype=np.uint8)


class TestCommand:
    def test_the_status_says_that_a_block_failed(self, blocks, tmp_path, capsys, without_pictures):
        words = ["batch", "adjust", str(blocks), "-o", str(tmp_path / "out"), "--required", "0.05"]
        assert main([*words, "--jobs", "1"]) == 1
        said = capsys.readouterr()
        assert said.err.splitlines()[-1].startswith("failed: 1 of 4 blocks, broken first; ")
        assert "! broken: " in said.out and said.out.rstrip().endswith("report.html")

    def test_the_status_is_0_where_none_failed(self, blocks, tmp_path, capsys, without_pictures):
        named = [str(blocks / name) for name in ("north", "west")]
        words = ["batch", "adjust", *named, "-o", str(tmp_path / "out"), "--required", "0.05"]
        assert main([*words, "--jobs", "1"]) == 0
        assert "2 blocks adjusted" in capsys.readouterr().out

    def test_options_of_the_verb_reach_every_block(self, blocks, tmp_path, monkeypatch):
        called = {}

        def record(verb, named, output, **options):
            called.update(options, verb=verb, blocks=named)
            raise corridor.InputError("seen")

        monkeypatch.setattr("corridor.tools.batch.batch", record)
        words = (
            "--camera fixed --required 0.02 --threads 1 --only focal --counterparts 19 --jobs 3 "
            "--scheduler tcp://here:1 --memory 2.5"
        )
        main(["batch", "diagnose", "a", "b", "-o", str(tmp_path / "out"), *words.split()])
        assert called["model"].camera == "fixed" and called["blocks"] == [Path("a"), Path("b")]
        assert (called["only"], called["required"], called["counterparts"]) == (["focal"], 0.02, 19)
        assert (called["jobs"], called["memory_gb"], called["cluster"]) == (3, 2.5, "tcp://here:1")

    @pytest.mark.parametrize(
        ("words", "told"),
        [
            ("diagnose {blocks} -o {out}", "wrote; name another folder for diagnose"),
            ("adjust {blocks} -o {blocks}", "so it is not replaced"),
            ("adjust {blocks} -o {new} --jobs 1 --effect gremlins", "gremlins"),
        ],
    )
    def test_what_cannot_be_begun_is_status_2(self, done, blocks, tmp_path, capsys, words, told):
        filled = words.format(blocks=blocks, out=done[1], new=tmp_path / "new")
        assert main(["batch", *filled.split()]) == 2
        assert told in capsys.readouterr().err.splitlines()[-1]
        assert not (tmp_path / "new").exists()


class Deadly(LinearEffect):
    """Kills the process that adjusts a block, as long as a file of the block's name is there."""

    slug, place, group = "deadly", "image", "camera"
    title, called = "A worker that dies", "a death"

    def __init__(self, folder):
        super().__init__()
        self.folder = folder

    def parameters(self, block):
        for name, gone in ((f"{block.name}.once", True), (f"{block.name}.always", False)):
            if (self.folder / name).exists():
                if gone:
                    (self.folder / name).unlink()
                os.kill(os.getpid(), signal.SIGKILL)
        return [Parameter("amplitude", "px", scale=1e-3)]

    def derivative(self, context):
        derivative = np.zeros((len(context), 2, 1))
        derivative[:, 0, 0] = np.sin(3 * np.pi * context.plane[:, 0])
        return derivative


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_a_worker_that_dies_costs_nothing_and_a_block_that_kills_workers_is_a_row(tmp_path):
    here, out = tmp_path / "blocks", tmp_path / "out"
    for number, name in enumerate("abc"):
        block = small(number)
        block.name = name
        block.write(here / name)
    (tmp_path / "b.once").touch()
    (tmp_path / "c.always").touch()
    asked = {"effects": [Deadly(tmp_path)], "required": 0.05}
    campaign = corridor.batch("adjust", here, out, jobs=2, **asked)
    assert [(row.block, row.verdict) for row in campaign.rows[:1]] == [("c", "failed")]
    assert "worker died" in campaign.rows[0].attention
    assert {row.block for row in campaign.rows[1:]} == {"a", "b"}
    assert not campaign.rows[1].failed
    # Nothing of a killed run stays, and two processes give the numbers of one.
    assert sorted(path.name for path in (out / "rows").iterdir()) == ["a.json", "b.json"]
    assert sorted(path.name for path in (out / "blocks").iterdir()) == ["a", "b"]
    (tmp_path / "c.always").unlink()
    again = corridor.batch("adjust", here, out, jobs=1, **asked)
    assert not again.failed
    other = tmp_path / "other"
    corridor.batch("adjust", here, other, jobs=1, **asked)
    for name in "abc":
        assert contents(out / "blocks" / name) == contents(other / "blocks" / name)


@pytest.mark.slow
def test_a_diagnosis_of_many_is_that_of_one_and_says_what_was_typed(tmp_path):
    block = small(5)
    block.write(tmp_path / "one")
    asked = {"only": ["clock_offset", "focal"], "seed": 3}
    campaign = corridor.batch(
        "diagnose",
        tmp_path / "one",
        tmp_path / "out",
        jobs=1,
        counterparts=19,
        command="corridor batch diagnose BLOCKS -o out",
        **asked,
    )
    diagnosis = corridor.diagnose(tmp_path / "one", **asked)
    row = campaign.rows[0]
    assert (row.verdict, row.sigma0) == (diagnosis.verdict, diagnosis.after.sigma0)
    said = json.loads((tmp_path / "out/blocks/one/diagnosis.json").read_text(encoding="utf-8"))
    assert said["gap"] == json.loads(json_text(diagnosis.gap))
    page = (tmp_path / "out/blocks/one/report.html").read_text(encoding="utf-8")
    assert f"corridor batch diagnose {tmp_path / 'one'} -o out" in page


@pytest.mark.slow
def test_a_dask_cluster_whose_worker_is_killed_gives_the_same_numbers(blocks, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    here = tmp_path / "blocks"
    for number in range(4):
        small(number).write(here / f"km_{number}")
    out, killed = tmp_path / "out", []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0"
    ) as cluster:

        def kill_one(step):
            if step.done == 2:
                worker = next(iter(cluster.workers.values()))
                killed.append(worker.pid)
                os.kill(worker.pid, signal.SIGKILL)

        campaign = corridor.batch(
            "adjust", here, out, cluster=cluster.scheduler_address, progress=kill_one, required=0.05
        )
    assert killed and not campaign.failed and len(campaign.rows) == 4
    assert not list(out.glob("rows/*.begun")) and not list(out.glob("blocks/.*"))
    for name in ("km_0", "km_3"):
        assert contents(out / "blocks" / name) == alone(here / name, tmp_path / name)


def test_folders_without_a_block_are_refused(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "picture.jpg").touch()
    for given, more in (([tmp_path], ""), ([tmp_path / "one", tmp_path / "two"], " nor do 1 more")):
        with pytest.raises(corridor.InputError, match=f"holds no block{more}: .* block.toml"):
            corridor.batch("adjust", given, tmp_path / "out")
    assert not (tmp_path / "out").exists()
