"""PATB's and BINGO's text means what its convention says, and a wrong convention is noticed."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corridor.core.camera import INTERIOR
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate
from corridor.tools.formats import Additions, import_project, prove, read_project
from corridor.tools.formats.rows import rows_of

FLIP = np.diag([1.0, -1.0, -1.0])
PIXEL_UM = 4.4
UNITS = {"mm": PIXEL_UM / 1000, "um": PIXEL_UM, "px": 1.0}
TURNS = {"deg": 1.0, "gon": 1 / 0.9, "rad": np.pi / 180}
CONVENTIONS = [
    ("mm", "principal point", "up", "omega phi kappa", "deg"),
    ("um", "centre", "up", "phi omega kappa", "gon"),
    ("px", "corner", "down", "matrix to ground", "deg"),
    ("mm", "corner", "up", "matrix to image", "deg"),
    ("px", "pixel", "down", "omega phi kappa", "rad"),
    ("um", "pixel", "up", "phi omega kappa", "deg"),
]


@pytest.fixture(scope="module")
def block():
    """A short survey, exact by its own poses and camera."""
    plan = Plan(
        "short", (Flight("F1", 50.0, images=8, strips=2),), axis_m=((0.0, 0.0), (0.0, 60.0)),
        ground=Ground(control=4, check=0),
        noise=Noise(tie_px=0.0, mark_px=0.0, gnss_m=(0.0, 0.0, 0.0), control_m=0.0),
    )  # fmt: skip
    made = simulate(plan, seed=3)
    # Exactly by its own poses, which are start values.
    rows = rows_of(made)
    exact = rows.pixels - rows.residuals()
    first = len(made.tie_points)
    made.tie_points = made.tie_points.assign(x=exact[:first, 0], y=exact[:first, 1])
    made.marks = made.marks.assign(x=exact[first:, 0], y=exact[first:, 1])
    return made


def written(block, folder, convention, said=None):
    """The block as text of a convention; `said`: what convention.toml says instead."""
    unit, origin, y, angles, turn = convention
    folder.mkdir()
    camera = next(iter(block.cameras.values()))
    width, height = camera.width, camera.height
    start = {
        "principal point": camera.interior[1:3],
        "centre": [(width - 1) / 2, (height - 1) / 2],
        # Of a picture whose y counts upwards, the corner and the first pixel are the lower left.
        "corner": [-0.5, height - 0.5 if y == "up" else -0.5],
        "pixel": [0.0, height - 1.0 if y == "up" else 0.0],
    }[origin]
    lines = []
    tables = [block.tie_points, block.marks]
    for image in block.images["image"]:
        lines.append(f"{image} {camera['f'] * PIXEL_UM / 1000:.4f}")
        for table in tables:
            mine = table[table["image"] == image]
            for point, x, row in mine[["point", "x", "y"]].itertuples(index=False):
                xy = (np.array([x, row]) - start) * [1, -1 if y == "up" else 1] * UNITS[unit]
                lines.append(f"{point} {xy[0]!r} {xy[1]!r} 1".replace("np.float64(", ""))
        lines.append("-99")
    (folder / "image.dat").write_text("\n".join(lines).replace(")", "") + "\n")
    poses = ["image x y z a b c"]
    for name, pose in zip(block.images["image"], block.poses, strict=True):
        turned = (FLIP @ rotation_from_quaternion(pose[3:])).T
        if angles.startswith("matrix"):
            values = (turned if angles.endswith("ground") else turned.T).ravel()
        else:
            order = "XYZ" if angles.startswith("omega") else "YXZ"
            values = Rotation.from_matrix(turned).as_euler(order, degrees=True) * TURNS[turn]
        poses.append(" ".join([name, *(f"{v:.12f}" for v in (*pose[:3], *values))]))
    (folder / "poses.txt").write_text("\n".join(poses) + "\n")
    unit, origin, y, angles, turn = said or convention
    interior = "\n".join(f"{key} = {camera[key]!r}" for key in INTERIOR)
    interior = interior.replace("np.float64(", "").replace(")", "")
    (folder / "convention.toml").write_text(
        f'[measurements]\nfile = "image.dat"\nunit = "{unit}"\norigin = "{origin}"\ny = "{y}"\n'
        f'[poses]\nfile = "poses.txt"\nangles = "{angles}"\nunit = "{turn}"\n'
        f"[camera.C]\nwidth = {width}\nheight = {height}\n{interior}\npixel_um = {PIXEL_UM}\n"
    )
    return folder


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda c: "-".join(c).replace(" ", "_"))
def test_text_of_a_stated_convention_is_the_block_again(block, convention, tmp_path):
    project = read_project(written(block, tmp_path / "text", convention))
    assert project.form == "bingo"
    proof = prove(project)
    assert proof.verdict == "proved" and proof.main.median < 1e-4
    turned = [rotation_from_quaternion(b.poses[:, 3:]) for b in (block, project.block)]
    np.testing.assert_allclose(turned[0], turned[1], atol=1e-8)
    count = len(block.tie_points) + len(block.marks)
    assert len(project.block.tie_points) == count


@pytest.mark.parametrize(
    "said",
    [
        ("um", "Centre", "up", "Phi-Omega-Kappa", "grad"),
        ("µm", "centre", "UP", "phi, omega, kappa", "Gons"),
    ],
)
def test_a_convention_in_other_words_is_understood(block, tmp_path, said):
    """A grad is a gon, and no radian."""
    folder = written(block, tmp_path / "text", CONVENTIONS[1], said)
    assert prove(read_project(folder)).verdict == "proved"


@pytest.mark.parametrize("mark", [";", ",", "\t"])
def test_poses_in_quotes_and_other_cells_are_read(block, tmp_path, mark):
    folder = written(block, tmp_path / "text", CONVENTIONS[0])
    rows = (folder / "poses.txt").read_text().splitlines()
    rows = [mark.join(f'"{cell}"' for cell in row.split()) for row in rows]
    (folder / "poses.txt").write_text("\n".join(rows) + "\n")
    project = read_project(folder)
    assert prove(project).verdict == "proved" and len(project.block.tie_points)


def test_a_focal_length_in_millimetres_is_named_where_nothing_reprojects(block, tmp_path):
    folder = written(block, tmp_path / "text", CONVENTIONS[2])
    path = folder / "convention.toml"
    path.write_text(re.sub("(?m)^f = .*", "f = 4.3", path.read_text()))
    assert "f is in pixels" in prove(read_project(folder)).refusal()


@pytest.mark.parametrize(
    ("meant", "said"),
    [("omega-deg", "omega-gon"), ("phi-gon", "omega-deg"), ("phi-rad", "phi-deg")],
)
def test_the_angles_that_would_explain_the_points_are_named(block, tmp_path, meant, said):
    def told(word):
        first, unit = word.split("-")
        return {"omega": "omega phi kappa", "phi": "phi omega kappa"}[first], unit

    folder = written(
        block,
        tmp_path / "text",
        ("um", "centre", "up", *told(meant)),
        ("um", "centre", "up", *told(said)),
    )
    (found,) = [one for one in read_project(folder).warnings if "would explain it" in one]
    angles, unit = told(meant)
    assert f'angles = "{angles}" and unit = "{unit}"' in found


def nearly_upright(block, share, seed):
    """The block with omega and phi of this share, seen so, with noise of 0.4 px."""
    made = block.copy()
    turned = (FLIP @ rotation_from_quaternion(made.poses[:, 3:])).transpose(0, 2, 1)
    angles = Rotation.from_matrix(turned).as_euler("XYZ") * [share, share, 1.0]
    seen = FLIP @ Rotation.from_euler("XYZ", angles).as_matrix().transpose(0, 2, 1)
    made.put("images", ("qw", "qx", "qy", "qz"), quaternion_from_rotation(seen))
    rows = rows_of(made)
    pixels = rows.pixels - rows.residuals()
    pixels += 0.4 * np.random.default_rng(seed).standard_normal(pixels.shape)
    first = len(made.tie_points)
    made.tie_points = made.tie_points.assign(x=pixels[:first, 0], y=pixels[:first, 1])
    made.marks = made.marks.assign(x=pixels[first:, 0], y=pixels[first:, 1])
    return made


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("share", "other", "told"),
    [
        (0.0, False, "cannot be checked"),
        (0.0, True, "cannot be checked"),
        (0.05, False, None),
        (0.05, True, "the rays meet better if|would explain it"),
    ],
)
def test_the_order_of_small_angles_is_told_or_said_to_be_untold(
    block, tmp_path, share, other, told, seed
):
    """Exchanged, angles of `a` radians turn an image by some a squared: seen where it is more than
    the noise of its points together; images that hang upright have no order."""
    meant = ("px", "centre", "down", "omega phi kappa", "deg")
    said = ("px", "centre", "down", "phi omega kappa" if other else "omega phi kappa", "deg")
    folder = written(nearly_upright(block, share, seed), tmp_path / "text", meant, said)
    project = read_project(folder)
    found = [
        one
        for one in (*project.notes, *project.warnings)
        if re.search("cannot be checked|meet better|would explain", one)
    ]
    assert len(found) == (told is not None)
    assert all(re.search(told, one) for one in found)
    if other and told == "the rays meet better if|would explain it":
        assert 'angles = "omega phi kappa"' in found[0]


def test_measured_control_becomes_marks(block, tmp_path):
    folder = written(block, tmp_path / "text", CONVENTIONS[0])
    block.ground[["point", "x", "y", "z"]].to_csv(tmp_path / "control.csv", index=False)
    added = Additions(ground=tmp_path / "control.csv")
    made = import_project(folder, "auto", tmp_path / "block", added=added)
    assert len(made.block.marks) == len(block.marks) and len(made.block.ground) == 4


@pytest.mark.parametrize(
    ("said", "named"),
    [
        (("mm", "principal point", "down", "omega phi kappa", "deg"), "y upwards in the image"),
        (("mm", "principal point", "up", "omega phi kappa", "gon"), "do not reproject"),
        (("mm", "principal point", "up", "matrix to ground", "deg"), "12 numbers belong"),
        (("px", "corner", "down", "omega phi kappa", "deg"), "do not reproject"),
        (("cm", "corner", "up", "omega phi kappa", "deg"), "unit is 'cm'"),
        (("mm", "corner", "up", "omega kappa phi", "deg"), "angles is 'omega kappa phi'"),
    ],
)  # fmt: skip
def test_a_wrong_convention_is_refused_by_name(block, tmp_path, said, named):
    folder = written(block, tmp_path / "text", CONVENTIONS[0], said)
    with pytest.raises(InputError, match=named):
        import_project(folder, "auto", tmp_path / "block")


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        (
            "image.dat",
            lambda text: re.sub(r"(\d)\.(\d)", r"\1,\2", text),
            "line 2: .* decimal comma",
        ),
        (
            "poses.txt",
            lambda text: re.sub(r"(\d)\.(\d)", r"\1,\2", text),
            "line 2: .* decimal comma",
        ),
        ("convention.toml", lambda text: text.replace("um = 4.4", "um = 44.0"), "correct pixel_um"),
        (
            "convention.toml",
            lambda text: text.replace("um = 4.4", "um = 0.0044"),
            "correct pixel_um",
        ),
    ],
)
def test_decimal_commas_and_a_wrong_pixel_are_refused(block, tmp_path, file, change, said):
    folder = written(block, tmp_path / "text", CONVENTIONS[0])
    path = folder / file
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=said):
        read_project(folder)


def test_a_file_that_is_cut_off_is_named(block, tmp_path):
    folder = written(block, tmp_path / "text", CONVENTIONS[0])
    text = (folder / "image.dat").read_text().splitlines()
    (folder / "image.dat").write_text("\n".join(text[:-1]))
    with pytest.raises(InputError, match="cut off"):
        read_project(folder)
