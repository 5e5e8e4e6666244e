"""Every usual mistake of convention, put into a good project by hand, is caught and named."""

from dataclasses import replace

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.tools.formats import Project, demand, prove, read_project

Q = ["qw", "qx", "qy", "qz"]
FLIP = np.diag([1.0, -1.0, -1.0])


def proof_of(block):
    return prove(Project("made", block.name, block))


def with_rotations(block, change):
    rotation = rotation_from_quaternion(block.images[Q].to_numpy(float))
    block.images[Q] = quaternion_from_rotation(change(rotation))
    return block


def swapped(block):
    camera = block.cameras["P1"]
    block.cameras["P1"] = camera.with_values(p1=camera["p2"], p2=camera["p1"])
    return block


def half_a_pixel(block):
    for table in (block.tie_points, block.marks):
        table[["x", "y"]] += 0.5
    return block


def other_half(block):
    camera = block.cameras["P1"]
    block.cameras["P1"] = camera.with_values(cx=camera["cx"] + 0.5, cy=camera["cy"] + 0.5)
    return block


def transposed(block):
    return with_rotations(block, lambda r: r.transpose(0, 2, 1))


def up_in_the_camera(block):
    return with_rotations(block, lambda r: FLIP @ r)


def up_in_the_image(block):
    for table in (block.tie_points, block.marks):
        table["y"] = 2999.0 - table["y"]
    return block


def up_in_both(block):
    return up_in_the_camera(up_in_the_image(block))


def backwards(block):
    """Our camera read as if its coefficients took the image to the ray."""
    from corridor.core.camera import image_to_ray, project

    camera = block.cameras["P1"]
    poses = block.images.set_index("image")
    rotation = rotation_from_quaternion(poses[Q].to_numpy(float))
    places = block.points.set_index("point")[["x", "y", "z"]]
    for table in (block.tie_points, block.marks):
        image = block.images["image"].tolist()
        at = np.array([image.index(name) for name in table["image"]])
        target = places.loc[table["point"]].to_numpy()
        seen = np.einsum("nij,nj->ni", rotation[at], target - poses[["x", "y", "z"]].to_numpy()[at])
        ray = seen[:, :2] / seen[:, 2:]
        noise = table[["x", "y"]].to_numpy() - project(
            target, poses[["x", "y", "z"]].to_numpy()[at], rotation[at], camera.interior
        )
        pixel = table[["x", "y"]].to_numpy()
        for _ in range(60):
            pixel = pixel + camera["f"] * (ray - image_to_ray(pixel, camera.interior))
        table[["x", "y"]] = pixel + noise
    return block


MISTAKES = {
    "p1 and p2 exchanged": swapped,
    "half a pixel of origin": half_a_pixel,
    "half a pixel of origin ": other_half,
    "a transposed rotation": transposed,
    "y upwards in the camera frame": up_in_the_camera,
    "y upwards in the image": up_in_the_image,
    "y upwards in the image and in the camera frame": up_in_both,
    "the other direction of distortion": backwards,
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_put_in_by_hand_is_refused_and_named(name, noisy):
    proof = proof_of(MISTAKES[name](noisy.copy()))
    assert proof.verdict == "refused"
    assert name.strip() in proof.explained[0]
    with pytest.raises(InputError, match=name.strip()):
        demand(proof, force=False)
    demand(proof, force=True)


# Points intersected from shifted rays take most of half a pixel with them.
@pytest.mark.parametrize("name", [name for name in MISTAKES if "half" not in name])
def test_it_is_named_where_points_are_intersected_from_the_wrong_rays_too(name, noisy):
    """Formats without points (Pix4D, Metashape's markers): nothing tells where the points are."""
    block = MISTAKES[name](noisy.copy())
    block.points = block.points[:0]
    block.ground = block.ground[:0]
    proof = proof_of(block)
    assert proof.verdict == "refused"
    assert any(name.split(" in ")[0] in sentence for sentence in proof.explained)


def test_a_good_project_is_not_accused(noisy, fraser8):
    for block in (noisy, fraser8):
        proof = proof_of(block)
        assert proof.verdict == "proved" and not proof.explained


@pytest.mark.parametrize(
    "name",
    ["colmap_sceaux", "opensfm_berlin", "photoscan_strasbourg", "pix4d_p1", "nvm_sceaux",
     "bundler_balbianello", "micmac_saisies", "photomodeler_strasbourg", "metashape_made"],
)  # fmt: skip
def test_no_real_project_is_accused(name, real_data):
    assert prove(read_project(real_data / "interchange" / name)).verdict == "proved"


@pytest.mark.parametrize("mistake", [swapped, transposed, up_in_both], ids=lambda f: f.__name__)
def test_a_mistake_in_a_real_project_is_named(mistake, real_data):
    """Pix4D's real block, whose points are intersected."""
    block = read_project(real_data / "interchange" / "pix4d_p1").block
    block.cameras = {"P1": next(iter(block.cameras.values()))}
    block.images["camera"] = "P1"
    if mistake is up_in_both:
        block.tie_points["y"] = block.cameras["P1"].height - 1.0 - block.tie_points["y"]
        block = up_in_the_camera(block)
    else:
        block = mistake(block)
    proof = proof_of(block)
    assert proof.verdict == "refused"
    named = {swapped: "p1 and p2", transposed: "transposed", up_in_both: "y upwards"}[mistake]
    assert any(named in sentence for sentence in proof.explained)


def test_one_damaged_observation_is_pointed_at(noisy):
    block = noisy.copy()
    block.tie_points.loc[7, "x"] += 700.0
    proof = proof_of(block)
    assert proof.verdict == "proved"
    row = block.tie_points.loc[7]
    assert any(
        f"point {row['point']} in image {row['image']}" in sentence for sentence in proof.sentences
    )


@pytest.mark.parametrize("mistake", [swapped, half_a_pixel], ids=lambda f: f.__name__)
def test_a_mistake_in_one_camera_of_several_is_named_with_it(mistake, noisy):
    """Its residuals are a third of all: the median does not show them."""
    block = noisy.copy()
    camera = block.cameras["P1"]
    block.cameras = {name: replace(camera, name=name) for name in ("P1", "P2", "P3")}
    block.images["camera"] = [f"P{1 + k % 3}" for k in range(len(block.images))]
    if mistake is half_a_pixel:
        mine = block.tie_points["image"].isin(block.images["image"][0::3])
        block.tie_points.loc[mine, ["x", "y"]] += 0.5
    else:
        block = swapped(block)
    proof = proof_of(block)
    assert proof.verdict == "refused"
    named = "p1 and p2" if mistake is swapped else "half a pixel"
    assert proof.explained[0].startswith("camera P1: ") and named in proof.explained[0]


def test_marks_half_a_pixel_off_are_told_beside_tie_points_that_are_right(fraser8):
    """A list of ground points may count its pixels from the corner of the picture."""
    block, rng = fraser8.copy(), np.random.default_rng(5)
    for table in (block.tie_points, block.marks):
        table[["x", "y"]] += rng.normal(0, 0.15, (len(table), 2))
    assert not any("of the marks" in told for told in proof_of(block).sentences)
    block.marks[["x", "y"]] += 0.5
    proof = proof_of(block)
    assert proof.verdict == "proved"
    assert any("of the marks, half a pixel" in told for told in proof.sentences)
