"""A rig of Pix4D's files: mountings as stated, exposures by their poses, one position each."""

import numpy as np
import pytest
from rigged import HEAD, mounting, rigged_block
from scipy.spatial.transform import Rotation

from corridor.core.block import as_mounted, mountings_of
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.tools.formats import read_project

CAMERAS = ("nadir", *HEAD)


@pytest.fixture
def params(tmp_path):
    """Pix4D's folder of a perfect rig, which lacks a member's and a reference camera's image."""
    block = rigged_block(exposures=6, lacking={(0, "left"), (1, "nadir")})
    rows = [
        "fileName imageWidth imageHeight ",
        *["of eight lines"] * 5,
        "camera model m = K [R|-Rt] X",
    ]
    errors = ["imageName, cameraIndex, cameraName, X_gps, Y_gps, Z_gps, X_acc, Y_acc, Z_acc"]
    pose = block.poses
    for image, camera, row in zip(block.images["image"], block.images["camera"], pose, strict=True):
        # Another focal length tells the cameras apart.
        f, n = 1500.0 + CAMERAS.index(camera), CAMERAS.index(camera)
        rows += [f"{image} 1200 800", f"{f} 0 600", f"0 {f} 400", "0 0 1", "0 0 0", "0 0"]
        rows += [" ".join(map(repr, row[:3].tolist()))]
        rows += [" ".join(map(repr, line)) for line in rotation_from_quaternion(row[3:]).tolist()]
        errors.append(f"{image}, {n}, {camera}, {int(image[-1])}, 7, 60, 0.02, 0.02, 0.04")
    rig = ["# Rig secondary cameras: cameraId unique_name", "Rig HEAD", '0 "nadir (RGB)" reference']
    for camera in HEAD:
        place, turn = mounting(camera)
        angles = Rotation.from_matrix(turn.T).as_euler("XYZ", degrees=True)
        numbers = " ".join(map(repr, [*angles.tolist(), *place.tolist()]))
        rig.append(f'{CAMERAS.index(camera)} "{camera} (RGB)(2)" {numbers}')
    for name, lines in (
        ("camera_parameters", rows), ("external_camera_parameters_error", errors),
        ("rig_parameters", rig),
    ):  # fmt: skip
        (tmp_path / f"s_calibrated_{name}.txt").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_the_rig_is_that_of_its_files(params):
    block = read_project(params).block
    (rig,) = block.extra["rig"].values()
    of = dict(zip(block.images["image"].str.split("_").str[0], block.images["camera"], strict=True))
    assert rig["base"] == of["nadir"] and set(rig["member"]) == {of[name] for name in HEAD}
    for name in HEAD:
        place, turn = mounting(name)
        found = mountings_of(block)[of[name]]
        assert found.place == pytest.approx(place, abs=1e-12)
        assert found.rotation == pytest.approx(turn, abs=1e-9)
        assert found.sigma[:3].tolist() == [0, 0, 0] and np.isinf(found.sigma[3:]).all()
    assert as_mounted(block)


def test_images_of_one_exposure_are_found_and_its_position_counts_once(params):
    block = read_project(params).block
    together = set(
        block.images.dropna(subset="exposure").groupby("exposure")["image"].agg(frozenset)
    )
    every = {frozenset(f"{c}_{k:03d}" for c in CAMERAS) for k in (2, 3, 4, 5)}
    assert together == every | {frozenset({"nadir_000", "right_000"})}
    alone = {"left_001", "right_001"}
    assert set(block.gnss["image"]) == {f"nadir_{k:03d}" for k in (0, 2, 3, 4, 5)} | alone


def test_a_mounting_that_is_cut_off_is_named(params):
    file = params / "s_calibrated_rig_parameters.txt"
    file.write_text(file.read_text().rsplit(" ", 2)[0] + "\n")
    with pytest.raises(InputError, match=r"rig_parameters.* 4 numbers where a mounting has six"):
        read_project(params)


def test_without_numbers_of_the_cameras_it_says_so(params):
    (params / "s_calibrated_external_camera_parameters_error.txt").unlink()
    project = read_project(params)
    assert "rig" not in project.block.extra
    assert any("states a rig, and no file says" in note for note in project.notes)


@pytest.mark.slow
def test_five_cameras_over_saraburi_stand_as_their_file_says(real_data):
    """253 exposures of data/oblique_rig: order and sense of the angles, to 1 um and 1e-6 rad."""
    block = read_project(real_data / "oblique_rig" / "params").block
    assert block.images["exposure"].nunique() == 253 == len(block.gnss)
    assert block.images["exposure"].notna().all() and as_mounted(block)
