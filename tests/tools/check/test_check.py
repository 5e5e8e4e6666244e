"""One command from a project to an answer, and what is taken back is what went in."""

import json
import re
import struct
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from corridor import cli
from corridor.core.adjustment import adjust
from corridor.core.block import read
from corridor.core.gnss import (
    Local,
    convert,
    in_world,
)
from corridor.core.preparation import plausibility_warnings
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate
from corridor.tools import formats as interchange
from corridor.tools.check import check_project, checking
from corridor.tools.check.advice import ProgramSettings
from corridor.tools.check.taking_back import proved, take_back
from corridor.tools.formats import (
    Additions,
    export_project,
    import_project,
    prove,
    read_adjusted,
    read_project,
)
from corridor.tools.formats.frames import local_table, moved

PLACE = Local(53.5, 8.2, 0.0)


@pytest.fixture(scope="module")
def block():
    """A short survey with noise, on Earth."""
    made = simulate(_plan(), seed=1)
    made.extra["local_frame"] = local_table(PLACE)
    return made


def _plan():
    return Plan(
        "short", (Flight("F1", 50.0, images=12, strips=2),), axis_m=((0.0, 0.0), (0.0, 80.0)),
        ground=Ground(control=4, check=3),
        noise=Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
    )  # fmt: skip


def _with_shutter():
    """The same draw of noise as `block`, read out in 30 ms."""
    made = simulate(_plan(), {"rolling_shutter": {"readout": 0.03}}, seed=1)
    made.extra["local_frame"] = local_table(PLACE)
    return made


def test_a_block_gets_an_answer_and_files(block, tmp_path):
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", required=0.2, diagnose=False)
    assert checked.verdict == "good enough" and "Good enough" in checked.sentence
    assert any(line.startswith("Free the parameters of the camera: f") for line in checked.settings)
    content = json.loads((tmp_path / "out" / "check.json").read_text())
    assert content["verdict"] == "good enough" and content["take_back"]["files"]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "What to take back" in page and "data:image/png" in page
    ground = (tmp_path / "out" / "take_back" / "ground.csv").read_text().splitlines()
    assert len(ground) == 1 + len(block.ground)
    # Without a system of its own a place on Earth gives its UTM zone.
    east = float(ground[1].split(",")[1])
    assert east == pytest.approx(in_world(block, block.numbers("ground", *"xyz"))[0, 0], abs=1e-3)


def test_without_a_folder_the_answer_lies_where_one_is(block, tmp_path, monkeypatch):
    """`corridor check PROJECT` is all that has to be typed; -o may stand before or behind."""
    block.write(tmp_path / "flights" / "river.v2")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert cli.main(["check", "../flights/river.v2", "--quick"]) == 0
    assert (tmp_path / "here" / "river.v2_checked" / "report.html").is_file()
    for words in (["a", "-o", "b"], ["-o", "b", "a"]):
        assert cli._parser("check").parse_args(["check", *words]).output == Path("b")


def test_not_good_enough_and_not_known_are_said(block, tmp_path):
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "a", required=1e-4, diagnose=False)
    assert checked.verdict == "not good enough"
    bare = block.copy()
    bare.ground = bare.ground.assign(role="control")
    bare.write(tmp_path / "bare")
    checked = check_project(tmp_path / "bare", tmp_path / "b", required=0.1, diagnose=False)
    assert checked.verdict == "not known" and "no check point" in checked.sentence


@pytest.mark.parametrize(
    "found", [None, {"verdict": "nothing", "sentence": "", "actions": ["OUT/x"]}]
)
def test_what_to_go_on_with_lies_where_it_is_said_to_lie(tmp_path, found):
    """Without a diagnosis there is no missing/block."""
    final = {"actions": ["Go on with OUT/block, from BLOCK."]}
    _, (action,) = checking._told(final, found, {"warnings": []}, tmp_path / "adjusted")
    if found:
        assert action == f"{tmp_path}/missing/x"
    else:
        assert action == f"Go on with {tmp_path}/adjusted/block, from {tmp_path}/block."


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


def test_every_file_that_is_taken_back_is_imported_again(block, tmp_path):
    """Camera, positions with a sigma an axis, control and marks: to the digits they are written."""
    grid = moved(block, "EPSG:25832")
    grid.write(tmp_path / "grid")
    checked = check_project(tmp_path / "grid", tmp_path / "out", diagnose=False)
    proof = checked.taken_back.proof
    assert "camera.toml read again: the same in every parameter" in proof
    ground = r" imported again: 7 points, the same to (\S+) mm, \d+ marks, the same to (\S+) px"
    for pattern in (
        r"positions.csv read again: 12 positions, the same to (\S+) mm, standard deviations the ",
        rf"ground.csv{ground}",
        rf"gcp_list.txt{ground}",
    ):
        found = re.search(pattern, proof)
        assert found and all(float(number) <= 1.0 for number in found.groups()), proof
    # As a program reads them: UTM, one sigma an axis.
    table = pd.read_csv(tmp_path / "out" / "take_back" / "positions.csv")
    assert abs(table["x"] - 500_000).max() < 100_000 and {"sx", "sy", "sz"} <= set(table)


def test_names_with_blanks_are_taken_back_and_imported_again(block, tmp_path):
    named = block.copy()
    new = {name: f"Flug 1/{name} (2).JPG" for name in block.images["image"]}
    for table in (named.images, named.gnss):
        table["image"] = table["image"].map(new)
    for table in (named.tie_points, named.marks):
        table["image"] = table["image"].cat.rename_categories(new)
    named.extra = {**named.extra, "local_frame": local_table(Local(47.5, 8.7, 0.0))}
    adjust(named).save(tmp_path / "adjusted")
    taken = take_back(tmp_path / "adjusted", tmp_path / "back", "block", ProgramSettings({}))
    assert re.search(r"gcp_list.txt imported again: 7 points, .*\d+ marks, the same", taken.proof)
    assert any("OpenDroneMap does not read" in told for told in taken.sentences)


def test_a_file_that_is_not_what_was_written_is_told(block, tmp_path):
    """The proof reads the files: what is wrong in them shows."""
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    folder = tmp_path / "out" / "take_back"
    measured, _ = read_adjusted(tmp_path / "out" / "adjusted")
    for name, column in (("positions.csv", "x"), ("ground.csv", "z"), ("marks.csv", "x")):
        table = pd.read_csv(folder / name)
        table[column] += 0.25
        table.to_csv(folder / name, index=False)
    told = proved(folder, measured, "", interchange)
    assert told.count("250 mm") == 2 and "0.25 px" in told, told
    assert "250" not in checked.taken_back.proof and "0.25" not in checked.taken_back.proof


def test_marks_are_taken_back_without_the_effect_that_was_found(block, tmp_path):
    """Marks of pictures with a rolling shutter come out as a camera without one would have them."""
    skewed = _with_shutter()
    adjusted = adjust(skewed, effects=["rolling_shutter"])
    adjusted.save(tmp_path / "adjusted")
    settings = ProgramSettings.of(adjusted.to_dict(), None, skewed)
    take_back(tmp_path / "adjusted", tmp_path / "back", "block", settings)
    marks = pd.read_csv(tmp_path / "back" / "marks.csv", dtype={"point": str})
    keys = ["point", "image"]
    both = marks.merge(skewed.marks.astype(dict.fromkeys(keys, str)), on=keys, suffixes=("", "_as"))
    both = both.merge(block.marks.astype(dict.fromkeys(keys, str)), on=keys, suffixes=("", "_true"))
    moved_px = np.hypot(both["x"] - both["x_as"], both["y"] - both["y_as"])
    left_px = np.hypot(both["x"] - both["x_true"], both["y"] - both["y_true"])
    # Half a picture's readout at that speed is some pixels; what is left is the readout's sigma.
    assert moved_px.max() > 1.0 and left_px.max() < 0.25 * moved_px.max()


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


def test_heights_of_a_geoid_that_is_not_there_stay_as_they_are(block, tmp_path):
    grid = moved(block, "EPSG:25832")
    grid.crs = "EPSG:25832+5773"
    grid.write(tmp_path / "grid")
    told = checking._imported(tmp_path / "grid", "auto", tmp_path / "block", {}, None)["warnings"]
    kept = read(tmp_path / "block").crs == grid.crs
    # Where the grid is installed the block goes into a local frame as any other.
    assert kept == any("adjusted in its grid as it is: " in line for line in told)


def test_the_command_prints_json_alone_on_standard_output(block, tmp_path, capfd):
    block.write(tmp_path / "block")
    arguments = ["check", str(tmp_path / "block"), "-o", str(tmp_path / "out"), "--quick"]
    assert cli.main([*arguments, "--json", "-"]) == 0
    out, err = capfd.readouterr()
    assert json.loads(out)["format"] == "block" and "adjusting" in err


def test_what_is_no_project_is_refused(tmp_path):
    assert cli.main(["check", str(tmp_path / "no"), "-o", str(tmp_path / "out"), "--quick"]) == 2


# --- the Earth -------------------------------------------------------------------------------


AROUND = 0.05 * np.arange(-20, 21)


def made_geoid(path):
    """A grid of undulations as PROJ reads it (.gtx): 47 m, sloping by some 30 mm a km, and uneven.

    Source: PROJ's resource files, NOAA VDatum: south, west, steps (degrees), rows and columns as
    big-endian numbers, then the values from the south-west corner on.
    """
    lat, lon = np.meshgrid(PLACE.lat_deg + AROUND, PLACE.lon_deg + AROUND, indexing="ij")
    height = 47 + 3 * (lat - lat.mean()) + 2 * (lon - lon.mean())
    height += 0.1 * np.sin(12 * lon) * np.cos(9 * lat)
    head = struct.pack(">4d2i", lat[0, 0], lon[0, 0], 0.05, 0.05, *height.shape)
    path.write_bytes(head + height.astype(">f4").tobytes())


@pytest.mark.parametrize("heights", ["above the ellipsoid", "above the geoid"])
def test_twenty_kilometres_in_utm_are_good_in_the_local_frame_and_named_in_the_grid(
    tmp_path, heights
):
    """Grid scale, convergence, curvature, geoid: none of them is an error in the local frame."""
    crs = "EPSG:25832"
    if heights == "above the geoid":
        made_geoid(tmp_path / "made.gtx")
        crs = f"+proj=utm +zone=32 +datum=WGS84 +geoidgrids={tmp_path / 'made.gtx'} +no_defs"
    # Pictures from 800 m: 20 km with few images.
    plan = Plan(
        "long", (Flight("F1", 800.0, strips=2, forward=0.7, side=0.6, speed_m_s=30.0),),
        axis_m=((0.0, 0.0), (20_000.0, 0.0)), ground=Ground(control=10, check=9),
        noise=Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
    )  # fmt: skip
    flat = simulate(plan, seed=2)
    flat.extra["local_frame"] = local_table(PLACE, crs)
    flat.lever_arm = {"F1": (0.10, -0.05, 0.35)}
    grid = moved(flat, crs)
    if heights == "above the geoid":
        crooked = convert(in_world(grid, grid.numbers("ground", *"xyz")), crs, "EPSG:4979")[:, 2]
        lower = crooked - grid.ground["z"].to_numpy() - grid.offset[2]
        assert 40 < lower.min() < lower.max() - 0.3
    grid.write(tmp_path / "grid")
    assert any(
        "not a Cartesian frame" in told and "curves" in told for told in plausibility_warnings(grid)
    )
    import_project(tmp_path / "grid", "block", tmp_path / "local", added=Additions(to_crs=crs))
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
