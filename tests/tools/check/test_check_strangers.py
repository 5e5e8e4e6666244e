"""Projects as strangers have them: an answer to each, or one sentence on what to bring."""

import json
import re
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from corridor import cli
from corridor.core.adjustment import adjust, may_be_zero
from corridor.core.camera import Camera, project
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate
from corridor.tools.check import check_project
from corridor.tools.check.advice import ProgramSettings
from corridor.tools.formats import export_project, import_project, read_project
from corridor.tools.formats.project import Contents, Views, ground_table
from tests.block_folder import small


def survey(images=10, marks=True, **more):
    """A short survey, exact by its own poses but for 0.3 px; `more`: of its ground."""
    plan = Plan(
        "short", (Flight("F1", 50.0, images=images, strips=2),), axis_m=((0.0, 0.0), (0.0, 60.0)),
        ground=Ground(**({"control": 4, "check": 2} | more)),
        noise=Noise(tie_px=0.3, mark_px=0.3, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
    )  # fmt: skip
    return simulate(plan, seed=4)


@pytest.fixture(scope="module")
def adjusted():
    return adjust(survey()).block


def flat(images, height=1000.0, reach=500.0, points=40, sigma_px=0.3):
    """Vertical pictures of flat ground from one height: f and the height are not told apart."""
    rng = np.random.default_rng(5)
    camera = Camera.from_table("aerial", {"width": 8000, "height": 8000, "f": 9000.0})
    centre = np.column_stack([np.linspace(-reach, reach, images), np.zeros(images)])
    centre = np.column_stack([centre, np.full(images, height)])
    down = rotation_from_vector(np.array([[np.pi, 0.0, 0.0]]))[0]
    rotation = np.stack([down] * images)
    ground = np.column_stack([rng.uniform(-reach, reach, (points, 2)), np.zeros(points)])
    rows = []
    for i in range(images):
        pixel = project(ground, centre[i], down, camera.interior)
        pixel += sigma_px * rng.standard_normal(pixel.shape)
        seen = ((pixel > 0) & (pixel < 7999)).all(axis=1)
        rows += [(f"P{p}", i, *pixel[p]) for p in np.flatnonzero(seen)]
    control = [0, 1, 2, 3, 4]
    at = {f"P{p}" for p in control}
    return Contents(
        name="flat",
        cameras={"aerial": camera},
        images=[f"{i}.tif" for i in range(images)],
        used=["aerial"] * images,
        centre=centre,
        rotation=rotation,
        ties=Views.of([row for row in rows if row[0] not in at]),
        marks=Views.of([row for row in rows if row[0] in at]),
        points=([f"P{p}" for p in range(points) if p not in control], ground[len(control) :]),
        ground=ground_table([f"P{p}" for p in control], ground[control]),
    ).project("made", "flat").block  # fmt: skip


def test_a_camera_that_the_images_do_not_determine_is_held_and_told(tmp_path):
    """Five pictures from one height over flat ground: focal length and height look alike."""
    flat(5).write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert checked.wrong[0].endswith("it is held at the calibration of the project.")
    assert checked.settings[0] == "Hold the camera at the calibration of the project."
    assert not any("Ground control is wrong" in told for told in checked.wrong)
    camera = checked.adjustment["camera"]["aerial"]
    assert camera["f"]["value"] == 9000.0 and not camera["f"]["sigma"]


@pytest.mark.parametrize("name", ["fixed", "fixed_calibration"])
@pytest.mark.parametrize(("value", "held"), [("true", True), ("1", True), ("0", False)])
def test_a_calibration_that_metashape_holds_is_held(adjusted, tmp_path, name, value, held):
    export_project(adjusted, "metashape", tmp_path / "project", lossy=True)
    for path in (tmp_path / "project").glob("*s.xml"):
        root = ElementTree.parse(path)
        for sensor in root.iter("sensor"):
            ElementTree.SubElement(sensor, "property", name=name, value=value)
        root.write(path)
    block = read_project(tmp_path / "project").block
    assert all(camera.calibrated is held for camera in block.cameras.values())


def test_a_project_before_its_adjustment_is_adjusted(adjusted, tmp_path):
    """Start values 0.3 m and half a degree off reproject to tens of px: that is no fault."""
    rough, rng = adjusted.copy(), np.random.default_rng(1)
    places = rough.numbers("images", *"xyz")
    rough.put("images", "xyz", places + 0.3 * rng.standard_normal(places.shape))
    export_project(rough, "colmap-text", tmp_path / "project", lossy=True)
    with pytest.raises(InputError, match="do not reproject"):
        import_project(tmp_path / "project", "auto", tmp_path / "b")
    checked = check_project(tmp_path / "project", tmp_path / "out", diagnose=False)
    assert checked.adjustment["converged"]
    assert any("by the poses of the project itself" in told.lower() for told in checked.wrong)


def test_a_camera_is_not_held_to_cover_another_mistake(tmp_path):
    """Marks of pictures made smaller: nothing is called good, and the mistake is told.

    Whether a free camera ends at a false optimum or at none is chance.
    """
    block = survey(control=6)
    block.marks = block.marks.assign(x=0.6 * block.marks["x"], y=0.6 * block.marks["y"])
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert checked.verdict in {"failed", "not known"}, checked.sentence
    assert not checked.adjustment.get("held", False)
    assert any("smaller" in told or "pictures of" in told for told in checked.wrong)


def test_a_mistake_of_convention_is_still_refused(adjusted, tmp_path):
    """A rotation vector of the other sign is the transposed rotation."""
    export_project(adjusted, "opensfm", tmp_path / "project", corrected=True)
    path = tmp_path / "project" / "reconstruction.json"
    content = json.loads(path.read_text())
    for shot in content[0]["shots"].values():
        shot["rotation"] = [-value for value in shot["rotation"]]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="transposed rotation"):
        check_project(tmp_path / "project", tmp_path / "out", diagnose=False)


def test_too_few_measurements_are_compared_by_the_poses_of_the_project(adjusted, tmp_path):
    """Marks of control without tie points: no pose can be adjusted, the rays can be compared."""
    bare = adjusted.copy()
    bare.tie_points, bare.points = bare.tie_points[:0], bare.points[:0]
    names = list(bare.ground["point"][:2])
    bare.marks = bare.marks[bare.marks["point"].isin(names)].reset_index(drop=True)
    export_project(bare, "metashape", tmp_path / "project", lossy=True)
    checked = check_project(tmp_path / "project", tmp_path / "out", required=0.05, diagnose=False)
    assert checked.verdict == "failed"
    told = " ".join(checked.wrong)
    assert "the rays of the marks meet" in told and "surveyed points (3D RMS)" in told
    assert "no tie points: name the .psx" in told


def test_a_project_without_measurements_says_what_to_bring(adjusted, tmp_path, capsys):
    bare = adjusted.copy()
    for table in ("tie_points", "marks", "points", "ground"):
        setattr(bare, table, getattr(bare, table)[:0])
    export_project(bare, "metashape", tmp_path / "project", lossy=True)
    words = ["check", str(tmp_path / "project"), "-o", str(tmp_path / "out"), "--quick"]
    assert cli.main(words) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "10 images and no image measurement" in said and "name the .psx" in said


def test_without_ground_points_the_advice_is_to_survey_some(adjusted, tmp_path):
    free = adjusted.copy()
    free.ground, free.marks = free.ground[:0], free.marks[:0]
    free.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert any("survey points on the ground" in action for action in checked.actions)
    assert not any("--check" in action for action in checked.actions)


def test_a_frame_described_in_words_is_no_system_and_no_fault(adjusted, tmp_path):
    local = adjusted.copy()
    local.crs = "local east, north, up about the church"
    local.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert checked.adjustment["converged"]
    assert not (tmp_path / "out" / "take_back" / "gcp_list.txt").exists()


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"gcp.txt": "EPSG:25832\n467317.0 5428902.0 54.7 30.5 15.5 a.JPG G1\n"}, "--ground"),
        ({"deep/er/gcp.txt": "WGS84 UTM 16N\n6e5 4.9e6 1 2 3 a.JPG\n"}, "--ground"),
        ({"my.toml": '[[flight]]\nname = "F1"\n'}, "corridor plan"),
        ({"a/rover.pos": "% GPST\n"}, "--track"),
        ({"a.obs": "     3.04  OBSERVATION DATA  RINEX VERSION / TYPE\n"}, "RINEX"),
        ({"a.p4d": "x"}, "params"),
    ],
)
def test_a_folder_that_is_no_project_is_named_for_what_it_is(tmp_path, files, said):
    for name, text in files.items():
        path = tmp_path / "folder" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    with pytest.raises(InputError, match=said):
        check_project(tmp_path / "folder", tmp_path / "out", diagnose=False)


@pytest.mark.parametrize("form", ["bundler", "opensfm"])
def test_a_project_whose_file_lies_in_a_folder_under_another_name_is_found(
    adjusted, tmp_path, form
):
    """Of OpenSfM `my.json`, of Bundler `a.out`: the content tells them."""
    export_project(adjusted, form, tmp_path / "made", corrected=True)
    folder = tmp_path / "folder"
    folder.mkdir()
    old = {"bundler": "bundle.out", "opensfm": "reconstruction.json"}[form]
    new = {"bundler": "a.out", "opensfm": "my.json"}[form]
    for file in (tmp_path / "made").iterdir():
        file.rename(folder / (new if file.name == old else file.name))
    project = read_project(folder)
    assert project.form == form and len(project.block.images) == len(adjusted.images)


def test_columns_put_into_a_block_as_texts_are_written_as_names(adjusted, tmp_path):
    made = adjusted.copy()
    made.tie_points = made.tie_points.assign(image=made.tie_points["image"].astype(str))
    made.write(tmp_path / "block")
    first, second = pd.read_csv(tmp_path / "block" / "tie_points.csv"), adjusted.tie_points
    assert list(first["image"]) == list(second["image"].astype(str))


def test_half_of_the_marks_are_no_outliers_because_ties_are_better_than_stated():
    """Ties stated 1 px and good to 0.2; marks stated 0.1 px and good to 1: no mark is wild."""
    block = survey(control=6)
    rng = np.random.default_rng(2)
    block.sigma = {**block.sigma, "tie_px": 1.5, "mark_px": 0.1}
    off = rng.standard_normal((len(block.marks), 2))
    block.marks = block.marks.assign(x=block.marks["x"] + off[:, 0], y=block.marks["y"] + off[:, 1])
    found = adjust(block).statistics["mark"]
    assert found["outliers"] < 0.2 * found["count"] and found["gross"] == 0


def test_coefficients_of_which_one_is_needed_are_not_all_held():
    """k1 to k3 of a lens that bends by a tenth of a pixel hide behind each other: none alone is two
    standard deviations, all together they are."""
    names = ["k1", "k2", "k3"]
    camera = pd.DataFrame({"camera": "c", "parameter": names, "value": [1.5, -1.4, 1.3],
                           "sigma": 1.0, "unit": "", "free": True})  # fmt: skip
    rho = np.array([[1, -0.98, 0.95], [-0.98, 1, -0.99], [0.95, -0.99, 1]])
    label = [f"camera.c.{name}" for name in names]
    for sign, held in ((1.0, names), (-1.0, ["k3"])):
        found = SimpleNamespace(
            camera=camera.assign(value=camera["value"] * [1, sign, 1]),
            correlation_matrix=pd.DataFrame(rho, index=label, columns=label),
        )
        assert list(may_be_zero(found)["parameter"]) == held


def test_the_accuracy_of_positions_is_that_which_was_used(tmp_path):
    """Metres are stated, and assumed; they scatter by centimetres, and count so."""
    block = survey(images=24)
    block.gnss = block.gnss.assign(sx=3.0, sy=3.0, sz=6.0)
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    positions = pd.read_csv(tmp_path / "out" / "take_back" / "positions.csv")
    used = positions[["sx", "sy", "sz"]].median()
    assert used.max() < 0.2
    told = next(one for one in checked.settings if "camera positions" in one)
    level, up = map(float, re.findall(r"([0-9.]+) mm", told))
    assert level == pytest.approx(1000 * used[["sx", "sy"]].max(), rel=0.3)
    assert up == pytest.approx(1000 * used["sz"], rel=0.3)


def test_what_contradicts_itself_gives_no_settings_back(tmp_path):
    """Start poses and positions both with heights in feet: an arm of a hundred metres."""
    block = survey()
    for table in ("images", "gnss"):
        frame = getattr(block, table)
        setattr(block, table, frame.assign(z=frame["z"] / 0.3048))
    block.write(tmp_path / "block")
    checked = check_project(tmp_path / "block", tmp_path / "out", diagnose=False)
    assert not checked.settings and checked.taken_back is None
    assert not (tmp_path / "out" / "take_back").exists()


def test_accuracies_count_what_residuals_have_lost():
    """Of 400 numbers 100 are spare: residuals are half as large as errors. One says nothing."""
    gnss = pd.DataFrame({"image": ["a"], "x": 0.0, "y": 0.0, "z": 0.0})
    block = small(gnss=gnss, sigma={"gnss_m": [3.0, 3.0, 6.0]})
    parts = [("tie", "", 400, 100.0), ("gnss", "plan", 20, 1.0), ("gnss", "height", 10, 2.5)]
    names = ("kind", "part", "count", "redundancy")
    settings = ProgramSettings.of(
        {
            "camera": {},
            "lever_arm": {},
            "observations": {"tie": {"rms": 0.2}, "gnss": {"rms": [0.001, 0.001, 0.02]}},
            "variance_components": [dict(zip(names, part, strict=True)) for part in parts],
        },
        None,
        block,
    )
    assert settings.image == {"tie points": pytest.approx(0.4)}
    assert settings.positions == (pytest.approx(3.0), pytest.approx(0.04))
