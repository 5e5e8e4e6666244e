"""Out and in again: observations, poses and cameras come back; other programs agree."""

import numpy as np
import pytest

import corridor
from corridor.core.errors import InputError
from corridor.tools.formats import export_project, prove, read_project

from .conftest import exact_block

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


def observations(block):
    """image, x, y of every tie point and mark, sorted."""
    rows = []
    for table in (block.tie_points, block.marks):
        images = table["image"].astype(str)
        rows += list(zip(images, table["x"], table["y"], strict=True))
    return sorted(rows)


def same_observations(one, two, tolerance=1e-6):
    a, b = observations(one), observations(two)
    assert [row[0] for row in a] == [row[0] for row in b]
    away = np.abs(np.array([r[1:] for r in a]) - np.array([r[1:] for r in b]))
    assert away.max() < tolerance


def same_poses(one, two):
    a = one.images.set_index("image")[POSE]
    b = two.images.set_index("image").loc[a.index, POSE]
    assert np.abs(a.to_numpy(float) - b.to_numpy(float)).max() < 1e-9


def same_cameras(one, two):
    a, b = next(iter(one.cameras.values())), next(iter(two.cameras.values()))
    away = np.abs(a.interior - b.interior) / np.maximum(np.abs(a.interior), 1.0)
    assert away.max() < 1e-9
    assert (a.width, a.height) == (b.width, b.height)


@pytest.mark.parametrize("form", ["colmap", "colmap-text", "opensfm", "micmac"])
def test_what_went_out_comes_back(form, fraser8, tmp_path):
    export_project(fraser8, form, tmp_path / "out")
    project = read_project(tmp_path / "out")
    same_observations(fraser8, project.block)
    same_poses(fraser8, project.block)
    same_cameras(fraser8, project.block)
    assert prove(project).verdict == "proved"


@pytest.mark.parametrize("form", ["colmap", "colmap-text", "opensfm", "micmac"])
def test_ground_points_and_marks_come_back_as_such(form, fraser8, tmp_path):
    block = fraser8.copy()
    block.extra["local_frame"] = {"lat_deg": 47.5, "lon_deg": 8.7, "height": 400.0}
    export_project(block, form, tmp_path / "out")
    back = read_project(tmp_path / "out").block
    assert sorted(back.marks["point"].unique()) == sorted(block.marks["point"].unique())
    given = block.ground.set_index("point")[["x", "y", "z"]]
    found = back.ground.set_index("point").loc[given.index, ["x", "y", "z"]]
    assert np.abs(found.to_numpy() - given.to_numpy()).max() < 1e-6


def test_bundler_comes_back_where_it_can_hold_the_camera(tmp_path):
    block = exact_block(k1=-0.06, k2=0.03, cx=1999.5, cy=1499.5)
    export_project(block, "bundler", tmp_path / "out")
    project = read_project(tmp_path / "out", size=(4000, 3000))
    same_observations(block, project.block)
    same_poses(block, project.block)
    same_cameras(block, project.block)


@pytest.mark.parametrize("form", ["colmap", "opensfm", "bundler", "metashape"])
def test_corrected_measurements_fit_the_camera_the_target_holds(form, tmp_path):
    """The residual stays that of the exact block, though the target lost b1, b2 and more."""
    block = exact_block(k1=-0.06, k2=0.03, k3=-0.01, p1=0.001, p2=-0.0008, b1=4e-4, b2=-3e-4)
    with pytest.raises(InputError, match="b2"):
        export_project(block, form, tmp_path / "refused")
    assert not (tmp_path / "refused").exists()
    export_project(block, form, tmp_path / "out", corrected=True)
    project = read_project(tmp_path / "out", size=(4000, 3000))
    assert prove(project).main.rms < 1e-6
    export_project(block, form, tmp_path / "lossy", lossy=True)
    assert prove(read_project(tmp_path / "lossy", size=(4000, 3000))).main.rms > 0.1


def test_metashape_marks_poses_and_camera_come_back(fraser8, tmp_path):
    export_project(fraser8, "metashape", tmp_path / "out")
    back = read_project(tmp_path / "out").block
    same_poses(fraser8, back)
    same_cameras(fraser8, back)
    assert len(back.marks) == len(fraser8.marks)
    assert np.abs(back.ground[["x", "y", "z"]].to_numpy()
                  - fraser8.ground[["x", "y", "z"]].to_numpy()).max() < 1e-9  # fmt: skip


def test_names_with_folders_blanks_and_other_letters_come_back(tmp_path):
    block = exact_block(names="vol é 1/IMG {:04d} ü.JPG")
    for form in ("colmap", "colmap-text", "opensfm", "bundler"):
        export_project(block, form, tmp_path / form, corrected=True)
        back = read_project(tmp_path / form, size=(4000, 3000)).block
        assert list(back.images["image"]) == list(block.images["image"])
    with pytest.raises(InputError, match="lies in a folder"):
        export_project(block, "micmac", tmp_path / "micmac")
    assert not (tmp_path / "micmac").exists()


@pytest.mark.parametrize("form", ["colmap", "colmap-text"])
def test_pycolmap_opens_it_and_computes_the_same_residual(form, noisy, tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="the extra `images` is not installed")
    export_project(noisy, form, tmp_path / "out")
    theirs = pycolmap.Reconstruction(str(tmp_path / "out"))
    assert theirs.num_reg_images() == len(noisy.images)
    stated = theirs.compute_mean_reprojection_error()
    theirs.update_point_3d_errors()
    computed = theirs.compute_mean_reprojection_error()
    from corridor.tools.formats.rows import rows_of

    rows = rows_of(noisy)
    length = np.nan_to_num(np.linalg.norm(rows.residuals(), axis=1))
    count = np.bincount(rows.point)
    mine = np.mean((np.bincount(rows.point, length) / np.maximum(count, 1))[count > 0])
    assert stated == pytest.approx(mine, abs=1e-6)
    assert computed == pytest.approx(mine, abs=1e-6)


def test_what_pycolmap_writes_is_read_the_same(fraser8, tmp_path):
    pycolmap = pytest.importorskip("pycolmap", reason="the extra `images` is not installed")
    export_project(fraser8, "colmap", tmp_path / "out")
    theirs = pycolmap.Reconstruction(str(tmp_path / "out"))
    for kind in ("text", "binary"):
        (tmp_path / kind).mkdir()
        getattr(theirs, f"write_{kind}")(str(tmp_path / kind))
        back = read_project(tmp_path / kind).block
        same_observations(fraser8, back)
        same_poses(fraser8, back)
        same_cameras(fraser8, back)


def test_gnss_goes_out_as_camera_centres(fraser8, tmp_path):
    """Antenna minus lever arm: with the arm that was added it is the centre again."""
    from corridor.core.geometry import rotation_from_quaternion

    block = fraser8.copy()
    arm = np.array([0.1, -0.2, 0.35])
    rotation = rotation_from_quaternion(block.images[POSE[3:]].to_numpy(float))
    antenna = block.images[POSE[:3]].to_numpy(float) + np.einsum("nji,j->ni", rotation, arm)
    block.gnss = block.images[["image"]].assign(
        **dict(zip("xyz", antenna.T, strict=True))
    )  # fmt: skip
    block.lever_arm = {"default": tuple(arm)}
    export_project(block, "colmap", tmp_path / "out")
    rows = [row.split() for row in (tmp_path / "out" / "reference.txt").read_text().splitlines()]
    found = np.array([[float(word) for word in row[1:]] for row in rows])
    assert np.abs(found - block.images[POSE[:3]].to_numpy(float)).max() < 1e-9


def test_a_panorama_of_opensfm_is_named_and_the_rest_imported(fraser8, tmp_path):
    import json

    export_project(fraser8, "opensfm", tmp_path / "out")
    file = tmp_path / "out" / "reconstruction.json"
    whole = json.loads(file.read_text())
    whole[0]["cameras"]["wide"] = {"projection_type": "spherical", "width": 100, "height": 100}
    first = next(iter(whole[0]["shots"]))
    whole[0]["shots"][first]["camera"] = "wide"
    file.write_text(json.dumps(whole))
    project = read_project(tmp_path / "out")
    assert len(project.block.images) == 11
    assert any("'spherical'" in s and "its 1 images were left out" in s for s in project.warnings)


def test_a_block_that_was_never_adjusted_goes_out_with_a_warning(fraser8, tmp_path):
    block = fraser8.copy()
    block.images["z"] += np.linspace(0, 3, len(block.images))
    made = export_project(block, "colmap", tmp_path / "out")
    assert any("adjust it first" in sentence for sentence in made.sentences)


def test_an_effect_that_nobody_may_lose_is_refused_by_name(fraser8, tmp_path):
    block = fraser8.copy()
    block.images[["vx", "vy", "vz"]] = [5.0, 0.0, 0.0]
    effects = {"rolling_shutter": {"readout": 0.03}}
    with pytest.raises(InputError, match="rolling_shutter.*--corrected"):
        export_project(block, "opensfm", tmp_path / "out", effects=effects)
    bent = corridor.effects.add(block, effects)
    export_project(bent, "opensfm", tmp_path / "out", effects=effects, corrected=True)
    assert prove(read_project(tmp_path / "out")).main.rms < 1e-3
    export_project(bent, "opensfm", tmp_path / "lossy", effects=effects, lossy=True)
    assert prove(read_project(tmp_path / "lossy")).main.rms > 1.0


def test_a_camera_without_a_model_is_told_by_its_kind_not_by_the_wording(
    fraser8, tmp_path, monkeypatch
):
    """The sentence of the error may say what it likes."""
    from corridor.tools.formats.cameras import NoModel
    from corridor.tools.formats.programs import colmap

    export_project(fraser8, "colmap-text", tmp_path / "out")
    home = tmp_path / "out"
    row = (home / "cameras.txt").read_text().splitlines()[-1]
    (home / "cameras.txt").write_text(f"{row}\n2 FOV 4000 3000 3600 3600 2000 1500 0.9\n")
    text = (home / "images.txt").read_text().replace(" 1 IMG_0000.JPG", " 2 IMG_0000.JPG")
    (home / "images.txt").write_text(text)
    for name in ("rigs.txt", "frames.txt"):
        (home / name).unlink()
    read = colmap.camera_of

    def worded_anew(*camera):
        try:
            return read(*camera)
        except NoModel:
            raise NoModel("another sentence") from None

    monkeypatch.setattr(colmap, "camera_of", worded_anew)
    project = read_project(home)
    assert len(project.block.images) == 11
    assert "another sentence: its 1 images were left out (IMG_0000.JPG)" in project.warnings
