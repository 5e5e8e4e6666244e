"""One command from a project to an answer, and what is taken back is what went in."""

import json

import numpy as np
import pytest

from corridor import cli
from corridor.core.adjustment import adjust
from corridor.core.block import read
from corridor.core.gnss import Local, in_world, local_table, moved
from corridor.core.preparation import doubts
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate
from corridor.tools.check import check_project, checking
from corridor.tools.formats import (
    Additions,
    export_project,
    import_project,
    prove,
    read_project,
)

PLACE = Local(53.5, 8.2, 0.0)


@pytest.fixture(scope="module")
def block():
    """A short survey with noise, on Earth."""
    plan = Plan(
        "short", (Flight("F1", 50.0, images=12, strips=2),), axis_m=((0.0, 0.0), (0.0, 80.0)),
        ground=Ground(control=4, check=3),
        noise=Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
    )  # fmt: skip
    made = simulate(plan, seed=1)
    made.extra["local_frame"] = local_table(PLACE)
    return made


def test_a_block_gets_an_answer_and_files(block, tmp_path):
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", required=0.2, diagnose=False)
    assert checked.verdict == "good enough" and "Good enough" in checked.sentence
    assert any(line.startswith("Free the camera parameters f") for line in checked.settings)
    content = json.loads((tmp_path / "out" / "check.json").read_text())
    assert content["verdict"] == "good enough" and content["take_back"]["files"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "What to take back" in page and "data:image/png" in page
    ground = (tmp_path / "out" / "take_back" / "ground.csv").read_text().splitlines()
    assert len(ground) == 1 + len(block.ground)
    # Without a system of its own a place on Earth gives its UTM zone.
    east = float(ground[1].split(",")[1])
    assert east == pytest.approx(in_world(block, block.numbers("ground", *"xyz"))[0, 0], abs=1e-3)


def test_not_good_enough_and_not_known_are_said(block, tmp_path):
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "a", required=1e-4, diagnose=False)
    assert checked.verdict == "not good enough"
    bare = block.copy()
    bare.ground = bare.ground.assign(role="control")
    bare.write(tmp_path / "bare")
    checked = check_project(tmp_path / "bare", tmp_path / "b", required=0.1, diagnose=False)
    assert checked.verdict == "not known" and "no check point" in checked.sentence


def test_what_was_done_is_kept_and_the_same_call_goes_on(block, tmp_path, monkeypatch):
    block.write(tmp_path / "block")
    said = []
    with monkeypatch.context() as patched:

        def stopped(*_):
            raise KeyboardInterrupt

        patched.setattr(checking, "take_back", stopped)
        with pytest.raises(KeyboardInterrupt):
            check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert (tmp_path / "out" / "adjusted" / "adjustment.json").is_file()
    check_project(
        tmp_path / "block",
        tmp_path / "out",
        diagnose=False,
        progress=lambda step: said.append(str(step)),
    )
    assert not any(line.startswith(("importing", "adjusting")) for line in said)
    # Another question is another check.
    check_project(
        tmp_path / "block",
        tmp_path / "out",
        diagnose=False,
        required=0.1,
        progress=lambda step: said.append(str(step)),
    )
    assert any(line.startswith("adjusting") for line in said)


def test_a_metashape_project_takes_back_what_imports_again(block, tmp_path):
    export_project(adjust(block).block, "metashape", tmp_path / "project", lossy=True)
    checked = check_project(tmp_path / "project", tmp_path / "out", diagnose=False)
    assert checked.form == "metashape"
    again = read_project(tmp_path / "out" / "take_back" / "project")
    assert prove(again).verdict == "proved"
    assert "imported again" in checked.taken_back.proof


def test_a_project_in_a_grid_is_adjusted_in_a_local_frame_and_goes_out_in_the_grid(block, tmp_path):
    grid = moved(block, "EPSG:25832")
    grid.write(tmp_path / "grid")
    checked = check_project(tmp_path / "grid", tmp_path / "out", required=0.2, diagnose=False)
    inside = read(tmp_path / "out" / "block")
    assert inside.crs is None and inside.extra["local_frame"]["crs"] == "EPSG:25832"
    head, *_ = (tmp_path / "out" / "take_back" / "gcp_list.txt").read_text().splitlines()
    assert head == "EPSG:25832" and checked.verdict == "good enough"


def test_the_command_prints_json_alone_on_standard_output(block, tmp_path, capfd):
    block.write(tmp_path / "block")
    arguments = ["check", str(tmp_path / "block"), "-o", str(tmp_path / "out"), "--quick"]
    assert cli.main([*arguments, "--json", "-"]) == 0
    out, err = capfd.readouterr()
    assert json.loads(out)["format"] == "block" and "adjusting" in err


def test_what_is_no_project_is_refused(tmp_path):
    assert cli.main(["check", str(tmp_path / "no"), "-o", str(tmp_path / "out"), "--quick"]) == 2


# --- the Earth -------------------------------------------------------------------------------


def test_twenty_kilometres_in_utm_are_good_in_the_local_frame_and_named_in_the_grid(tmp_path):
    """Grid scale, convergence and curvature: none of them is an error in the local frame."""
    # Pictures from 800 m: 20 km with few images.
    plan = Plan(
        "long", (Flight("F1", 800.0, strips=2, forward=0.7, side=0.6, speed_m_s=30.0),),
        axis_m=((0.0, 0.0), (20_000.0, 0.0)), ground=Ground(control=10, check=9),
        noise=Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
    )  # fmt: skip
    flat = simulate(plan, seed=2)
    flat.extra["local_frame"] = local_table(PLACE, "EPSG:25832")
    flat.lever_arm = {"F1": (0.10, -0.05, 0.35)}
    grid = moved(flat, "EPSG:25832")
    grid.write(tmp_path / "grid")
    assert any("not a Cartesian frame" in told and "curves" in told for told in doubts(grid))
    import_project(
        tmp_path / "grid", "block", tmp_path / "local", added=Additions(to_crs="EPSG:25832")
    )
    # A free focal length, or a free lever arm, takes up the scale of the grid.
    local, plain = (
        adjust(read(tmp_path / name), camera="fixed", lever_arm="fixed")
        for name in ("local", "grid")
    )
    off = local.check_points[["dx", "dy", "dz"]].to_numpy()
    sigma = local.check_points[["sx", "sy", "sz"]].to_numpy()
    # The sum of squares of 27 normalised numbers is above 47 once in a hundred blocks.
    assert np.sum((off / np.hypot(sigma, 0.005)) ** 2) < 47
    assert abs(local.sigma0 - 1) < 0.05
    # 400 ppm of 800 m of height, which the images and the GNSS cannot both have.
    assert plain.check_rms.d3 > 3 * local.check_rms.d3
