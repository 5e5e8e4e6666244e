"""COLMAP's rigs: a camera beside another one, posed by the frame they share."""

import numpy as np
import pytest
from rigged import rig_table, rigged_block

from corridor.core.adjustment import adjust
from corridor.core.errors import InputError
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.tools.formats import export_project, prove, read_project

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


@pytest.fixture
def rig(fraser8, tmp_path):
    """The text model with images 1 and 2 as one frame of a rig of two cameras."""
    export_project(fraser8, "colmap-text", tmp_path / "model")
    home = tmp_path / "model"
    pose = fraser8.images[POSE].to_numpy(float)
    rotation = rotation_from_quaternion(pose[:, 3:])
    shift = -np.einsum("nij,nj->ni", rotation, pose[:, :3])
    # sensor from rig: T2 = S T1
    own = rotation[1] @ rotation[0].T
    beside = shift[1] - own @ shift[0]
    cameras = (home / "cameras.txt").read_text().splitlines()
    row = cameras[-1].split(maxsplit=1)[1]
    (home / "cameras.txt").write_text(f"1 {row}\n2 {row}\n")
    text = (home / "images.txt").read_text().replace(" 1 IMG_0001.JPG", " 2 IMG_0001.JPG")
    (home / "images.txt").write_text(text)
    sensor = " ".join(
        map(repr, [*quaternion_from_rotation(own[None])[0].tolist(), *beside.tolist()])
    )
    (home / "rigs.txt").write_text(f"1 2 CAMERA 1 CAMERA 2 1 {sensor}\n2 1 CAMERA 1\n")
    frames = []
    for k in range(len(pose)):
        if k == 1:
            continue
        numbers = " ".join(map(repr, [*pose[k, 3:].tolist(), *shift[k].tolist()]))
        data = "2 CAMERA 1 1 CAMERA 2 2" if k == 0 else f"1 CAMERA 1 {k + 1}"
        frames.append(f"{k + 1} {1 if k == 0 else 2} {numbers} {data}\n")
    (home / "frames.txt").write_text("".join(frames))
    return home


def test_poses_of_a_rig_are_those_of_frame_and_sensor_together(rig, fraser8):
    project = read_project(rig)
    found = project.block.images[POSE].to_numpy(float)
    assert np.abs(found - fraser8.images[POSE].to_numpy(float)).max() < 1e-9
    assert not project.warnings
    assert any("2 cameras hang together in 1 rig, 1 exposures" in note for note in project.notes)
    taken = project.block.images.dropna(subset="exposure")
    assert taken["exposure"].nunique() == 1 and taken["camera"].nunique() == 2
    (table,) = project.block.extra["rig"].values()
    assert {table["base"], *table["member"]} == set(taken["camera"])
    project.block.check()


def test_the_frames_win_over_the_images_and_it_is_said(rig, fraser8):
    """As COLMAP does since it has rigs."""
    rows = (rig / "images.txt").read_text().splitlines()
    k = next(k for k, row in enumerate(rows) if row.endswith("IMG_0001.JPG"))
    words = rows[k].split()
    turned = rotation_from_vector(np.array([[0.0, 0.3, 0.0]]))[0]
    wrong = turned @ rotation_from_quaternion(np.array([words[1:5]], dtype=float))[0]
    words[1:5] = map(repr, quaternion_from_rotation(wrong[None])[0].tolist())
    rows[k] = " ".join(words)
    (rig / "images.txt").write_text("\n".join(rows) + "\n")
    project = read_project(rig)
    assert any("1 images have another pose in the frames" in s for s in project.warnings)
    assert prove(project).verdict == "proved"


def test_pycolmap_sees_the_same_rig(rig, fraser8):
    pycolmap = pytest.importorskip("pycolmap", reason="the extra `images` is not installed")
    model = pycolmap.Reconstruction(str(rig))
    theirs = {image.name: image.projection_center() for image in model.images.values()}
    block = read_project(rig).block
    for name, *place in block.images[["image", "x", "y", "z"]].itertuples(index=False):
        assert np.abs(theirs[name] - place).max() < 1e-9


def test_a_frame_of_an_unknown_camera_is_refused(rig):
    text = (rig / "frames.txt").read_text().replace("CAMERA 2 2", "CAMERA 7 2")
    (rig / "frames.txt").write_text(text)
    with pytest.raises(InputError, match="camera 7 of rig 1"):
        read_project(rig)


@pytest.fixture(scope="module")
def block():
    return rigged_block(exposures=6, lacking={(0, "left"), (1, "nadir")})


class TestExport:
    """A rig of three cameras by code of its own (tests/rigged.py)."""

    def test_pycolmap_reads_the_rig(self, block, tmp_path):
        pycolmap = pytest.importorskip("pycolmap", reason="the extra `images` is not installed")
        export_project(block, "colmap", tmp_path / "model")
        model = pycolmap.Reconstruction(str(tmp_path / "model"))
        assert len(model.rigs) == 1 and len(model.frames) == block.images["exposure"].nunique()
        theirs = {image.name: image.projection_center() for image in model.images.values()}
        for name, *place in block.images[["image", "x", "y", "z"]].itertuples(index=False):
            assert np.abs(theirs[name] - place).max() < 1e-9

    def test_a_format_without_rigs_says_that_they_are_lost(self, block, tmp_path):
        said = export_project(block, "bundler", tmp_path / "model").sentences
        assert any("lost: the rigs HEAD" in sentence for sentence in said)

    def test_an_adjusted_rig_goes_out_with_the_mountings_that_were_found(self, block, tmp_path):
        """Which the adjusted block states: they are no effect that a model cannot hold."""
        free = block.copy()
        free.extra = {"rig": rig_table(sigma_m=0.01, sigma_deg=0.1)}
        free.lever_arm = {"F1": (0.0, 0.0, 0.0)}
        adjust(free, camera="fixed", lever_arm="fixed").save(tmp_path / "out")
        said = export_project(tmp_path / "out", "colmap", tmp_path / "model").sentences
        assert not any("mounting" in sentence or "rig" in sentence for sentence in said)
