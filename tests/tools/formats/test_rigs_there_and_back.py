"""Rigs in and out: a head of three cameras by code of its own (tests/rigged.py)."""

import numpy as np
import pytest
from rigged import HEAD, mounting, rigged_block

from corridor.core.block import mountings_of
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_quaternion
from corridor.tools.formats import export_project, read_project

POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]


@pytest.fixture(scope="module")
def block():
    return rigged_block(exposures=6, lacking={(0, "left"), (1, "nadir")})


@pytest.fixture(scope="module")
def led():
    """In which no exposure lacks the base."""
    return rigged_block(exposures=6, lacking={(0, "left"), (2, "right")})


def same_rig(block, project):
    """Poses, exposures and mountings are those of the block."""
    back = project.block.images.set_index("image").loc[block.images["image"]]
    here, again = (one[POSE].to_numpy(float) for one in (block.images, back))
    assert again[:, :3] == pytest.approx(here[:, :3], abs=1e-9)
    turned = rotation_from_quaternion(here[:, 3:])
    assert rotation_from_quaternion(again[:, 3:]) == pytest.approx(turned, abs=1e-9)
    there = set(block.images.groupby("exposure")["image"].agg(frozenset))
    assert set(back.reset_index().groupby("exposure")["image"].agg(frozenset)) == there
    of = dict(zip(back["camera"], block.images["camera"], strict=True))
    found = {of[k]: one for k, one in mountings_of(project.block).items()}
    for name in HEAD:
        place, turn = mounting(name)
        assert found[name].place == pytest.approx(place, abs=1e-9)
        assert found[name].rotation == pytest.approx(turn, abs=1e-9)


@pytest.mark.parametrize("form", ["colmap", "colmap-text", "opensfm", "metashape"])
def test_a_rig_comes_back_with_its_mountings_and_exposures(block, led, form, tmp_path):
    block = led if form == "metashape" else block
    said = export_project(block, form, tmp_path / "model").sentences
    assert not any("rig" in sentence for sentence in said)
    same_rig(block, read_project(tmp_path / "model"))


@pytest.mark.parametrize("form", ["colmap-text", "opensfm", "metashape"])
def test_images_that_stand_otherwise_go_alone_and_it_is_said(block, form, tmp_path):
    moved = block.copy()
    moved.images.loc[3, "x"] += 0.01
    said = export_project(moved, form, tmp_path / "model").sentences
    assert any("do not stand as they say" in sentence for sentence in said)
    assert "rig" not in read_project(tmp_path / "model").block.extra


def test_metashape_has_no_exposure_without_the_base_and_it_is_said(block, tmp_path):
    said = export_project(block, "metashape", tmp_path / "model").sentences
    assert any("without the rig's base camera" in sentence for sentence in said)
    back = read_project(tmp_path / "model").block
    images = back.images.set_index("image")
    assert np.isfinite(back.poses).all() and images["exposure"].isna()["left_001"]
    assert images["exposure"].notna().sum() == len(images) - 2


def test_a_shot_of_no_rig_camera_is_refused(block, tmp_path):
    export_project(block, "opensfm", tmp_path / "model")
    path = tmp_path / "model" / "reconstruction.json"
    path.write_text(path.read_text().replace('"left_001": "left"', '"left_001": "lef"'))
    with pytest.raises(InputError, match="reconstruction.json.*rig_camera_ids names no rig camera"):
        read_project(tmp_path / "model")


class TestMmvii:
    """MicMac's orientations beside a rigid block of MMVII, which names cameras and moments."""

    def exported(self, block, folder, **changed):
        export_project(block, "micmac", folder)
        rig = {"Name": '"HEAD"', "Pattern": '"([a-z]+)_(.*)"', "KPatBloc": 1, "KPatSync": 2,
               "Master": '"nadir"', "RelPoses": ""} | changed  # fmt: skip
        text = "".join(f"<{tag}>{value}</{tag}>" for tag, value in rig.items())
        home = folder / "MMVII-PhgrProj" / "RigBlock" / "Rig"
        home.mkdir(parents=True)
        (home / "RigidBloc_HEAD.xml").write_text(
            '<?xml version="1.0" encoding="ISO8859-1" standalone="yes" ?><Root>'
            '<Type>"MMVII_Serialization"</Type><Version>"0.0.0"</Version>'
            f"<Data><RigidBlocCam>{text}</RigidBlocCam></Data></Root>"
        )
        return read_project(folder)

    def test_its_rig_is_read(self, block, tmp_path):
        same_rig(block, self.exported(block, tmp_path / "model"))

    @pytest.mark.parametrize("changed, said", [
        ({"Pattern": '"([a-z]+_(.*)"'}, "RigidBloc_HEAD.xml: .*no regular expression"),
        ({"KPatSync": 3}, "KPatSync = 3, but Pattern has 2 groups"),
    ])  # fmt: skip
    def test_a_pattern_that_cannot_be_is_refused(self, block, tmp_path, changed, said):
        with pytest.raises(InputError, match=said):
            self.exported(block, tmp_path / "model", **changed)

    def test_images_of_no_rig_and_cameras_that_cannot_be_told_apart_are_said(self, block, tmp_path):
        notes = self.exported(block, tmp_path / "one", Pattern='"(nadir|left)_(.*)"').notes
        assert any("images are in no rigid block (first: right_000)" in note for note in notes)
        project = self.exported(block, tmp_path / "two", Pattern='"([a-z]+)_(..).*"')
        assert any("a rig was left out" in note for note in project.notes)
        assert "rig" not in project.block.extra
