"""Ground control places a project, and tells its height system and the size of its pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from corridor import adjust
from corridor.core.block import POSE
from corridor.core.errors import InputError
from corridor.core.geometry import Similarity, rotation_from_vector
from corridor.core.photographs import Metadata
from corridor.core.preparation import derived
from corridor.tools.formats import Project, add_ground
from corridor.tools.formats.control import marks_refused, moved_by
from corridor.tools.formats.importing import Additions, complete

from .conftest import exact_block

TURN = rotation_from_vector(np.array([[0.3, -1.2, 0.7]]))[0]
FREE = Similarity(0.07, TURN, np.array([1.0, 2.0, 3.0]))


@pytest.fixture
def surveyed(tmp_path):
    """A block, its ground points in files, and the same project without them, in a free frame."""
    block = exact_block(k1=-0.05, k2=0.02)
    names, marks = block.ground, block.marks
    lines = ["EPSG:32632"]
    at = names.set_index("point")
    for row in marks.itertuples():
        x, y, z = at.loc[row.point, ["x", "y", "z"]]
        lines.append(f"{x + 4e5} {y + 5e6} {z} {row.x} {row.y} {row.image} {row.point}")
    (tmp_path / "gcp_list.txt").write_text("\n".join(lines))
    names.to_csv(tmp_path / "ground.csv", index=False)
    marks.to_csv(tmp_path / "marks.csv", index=False)
    bare = replace(block, ground=block.ground[:0], marks=block.marks[:0],
                   points=block.points[~block.points["point"].str.startswith("GCP")])  # fmt: skip
    return block, bare, tmp_path


def free(bare):
    return moved_by(Project("photos", Path("flight"), bare, placed=False), FREE)


@pytest.mark.parametrize(("file", "crs"), [("ground.csv", None), ("gcp_list.txt", "EPSG:32632")])
def test_control_places_a_free_project(surveyed, file, crs):
    block, bare, home = surveyed
    found = add_ground(free(bare), home / file)
    assert found.placed and found.block.crs == crs
    there = found.block.poses[:, :3] + found.block.offset - [*((4e5, 5e6) if crs else (0, 0)), 0]
    assert there == pytest.approx(block.poses[:, :3], abs=1e-3)
    assert marks_refused(found) is None
    (one,) = derived(found.block)
    assert one.column == "images.x" and one.witnesses[0].says == "agrees"


def test_a_wrong_ground_point_is_named_and_does_not_place(surveyed):
    block, bare, home = surveyed
    table = block.ground.copy()
    table.loc[1, "x"] += 30.0
    table.to_csv(home / "ground.csv", index=False)
    found = add_ground(free(bare), home / "ground.csv")
    (said,) = found.warnings
    assert table["point"][1] in said and "are names or coordinates wrong?" in said


def test_a_point_that_few_narrow_rays_see_is_not_accused(surveyed):
    """Half a pixel in two images side by side is decimetres along the rays."""
    block, bare, home = surveyed
    marks, name = block.marks.copy(), block.ground["point"][1]
    mine = marks.index[marks["point"].astype(str) == name]
    rows = block.image_rows("marks")[mine]
    centre = block.poses[rows, :3]
    apart = np.linalg.norm(centre[1:] - centre[:-1], axis=1)
    pair = mine[[apart.argmin(), apart.argmin() + 1]]
    marks.loc[pair, "x"] += [0.5, -0.5]
    marks.drop(mine.difference(pair)).to_csv(home / "marks.csv", index=False)
    found = add_ground(free(bare), home / "ground.csv")
    assert found.warnings == []
    assert derived(found.block)[0].witnesses[0].says == "agrees"


@pytest.mark.parametrize("up", [70.5, -48.0, 320.0])
def test_another_height_system_is_taken_and_said_with_both_heights(surveyed, up):
    block, bare, home = surveyed
    gnss = block.images[["image", "x", "y", "z"]].assign(sx=3.0, sy=3.0, sz=6.0)
    lifted = replace(bare, gnss=gnss, crs="EPSG:32632")
    lifted = moved_by(Project("photos", Path("x"), lifted),
                      Similarity(1.0, np.eye(3), np.array([0, 0, up])))  # fmt: skip
    lifted = lifted.having(gnss=gnss.assign(z=gnss["z"] + up))
    found = add_ground(lifted, home / "ground.csv")
    told = [note for note in found.notes if "another height system" in note]
    assert f"{abs(up):.1f} m {'below' if up > 0 else 'above'}" in told[0]
    assert found.block.poses[:, :3] == pytest.approx(block.poses[:, :3], abs=1e-2)
    assert found.block.gnss["z"].to_numpy() == pytest.approx(gnss["z"].to_numpy(), abs=1e-2)
    one = next(one for one in derived(found.block) if one.column == "gnss.z")
    assert [w.says for w in one.witnesses] == ["agrees", "agrees"] and one.sigma > 0


def test_control_in_another_place_is_refused_with_both_numbers(surveyed):
    block, bare, home = surveyed
    gnss = block.images[["image", "x", "y", "z"]].assign(sx=3.0, sy=3.0, sz=6.0)
    block.ground.assign(x=block.ground["x"] + 6.8e6).to_csv(home / "ground.csv", index=False)
    project = Project("photos", Path("x"), replace(bare, gnss=gnss, crs="EPSG:32632"))
    with pytest.raises(InputError, match=r"6,800,000\.0 m horizontally and [-+]0\.0 m vertically"):
        add_ground(project, home / "ground.csv")


@pytest.mark.parametrize("factor", [5.0, 2.5, 1.6])
def test_marks_of_the_pictures_as_taken_come_into_those_of_the_block(surveyed, factor):
    block, bare, home = surveyed
    width = round(4000 * factor)
    lines = (home / "gcp_list.txt").read_text().splitlines()
    larger = [lines[0]]
    for line in lines[1:]:
        words = line.split()
        words[3:5] = [str(factor * (float(word) + 0.5) - 0.5) for word in words[3:5]]
        larger.append(" ".join(words))
    (home / "gcp_list.txt").write_text("\n".join(larger))
    photos = {
        row: Metadata(Path(name), 4000, 3000, written_size=(width, round(width * 0.75)))
        for row, name in enumerate(block.images["image"])
    }
    found = add_ground(free(bare), home / "gcp_list.txt", photos)
    assert any(f"measured in pictures of {width} px" in note for note in found.notes)
    back = found.block.marks.sort_values(["point", "image"])[["x", "y"]].to_numpy()
    was = block.marks.sort_values(["point", "image"])[["x", "y"]].to_numpy()
    assert back == pytest.approx(was, abs=0.01)


def test_a_system_without_marks_is_not_laid_on_a_frame_of_its_own(surveyed):
    """Local metres became EPSG:25832 by points that no image shows."""
    block, bare, home = surveyed
    project = free(bare).having(ground=block.ground, marks=block.marks)
    rows = [f"P{k},{467000 + 9 * k}.123,{5428000 + k * k}.456,160.5" for k in range(5)]
    (home / "other.csv").write_text("\n".join(["name,E,N,H", *rows]))
    with pytest.raises(InputError, match="nothing joins the two: call the points as the project"):
        add_ground(project, home / "other.csv", crs="EPSG:25832")


def test_heights_that_are_all_the_same_are_doubted(surveyed):
    block, bare, home = surveyed
    block.ground.assign(z=3.0).to_csv(home / "ground.csv", index=False)
    said = add_ground(free(bare), home / "ground.csv").warnings
    assert "all heights are 3 m, so they look typed" in said[-1]
    said = add_ground(free(bare), home / "gcp_list.txt").warnings
    assert said == []


def test_two_ground_points_place_nothing_and_that_is_said(surveyed):
    block, bare, home = surveyed
    block.ground.head(2).to_csv(home / "ground.csv", index=False)
    found = add_ground(free(bare), home / "ground.csv")
    assert not found.placed and "needs three" in found.warnings[0]


def test_a_project_that_nothing_places_says_so_and_gets_no_velocity(surveyed):
    _, bare, _ = surveyed
    found = complete(free(bare), Additions())
    assert found.block.extra["frame"] == "arbitrary"
    assert any("its scale are arbitrary" in warning for warning in found.warnings)
    from corridor import prepare

    made = prepare(found.block)
    assert not made.block.has("images.vx") and set(POSE) <= set(made.block.images)


def test_an_adjustment_with_control_takes_a_block_out_of_its_own_frame(surveyed):
    block, bare, _ = surveyed
    lost = complete(free(bare), Additions()).block
    assert adjust(lost, camera="fixed").block.extra["frame"] == "arbitrary"
    lost.ground, lost.marks = block.ground, block.marks
    found = adjust(lost, camera="fixed").block
    assert "frame" not in found.extra
    assert found.poses[:, :3] == pytest.approx(block.poses[:, :3], abs=1e-3)
