"""What the tests of interchange share: an adjusted block, and one that is exact."""

import numpy as np
import pandas as pd
import pytest

from corridor.core.block import Block
from corridor.core.camera import Camera, project
from corridor.core.geometry import quaternion_from_rotation, rotation_from_vector
from corridor.tools.formats.project import observations_table


def exact_block(seed=0, images=12, points=160, names="IMG_{:04d}.JPG", **interior):
    """Images over a hilly ground, observations without error; marks of four ground points."""
    rng = np.random.default_rng(seed)
    values = {"f": 3600.0, "cx": 2003.25, "cy": 1494.5} | interior
    camera = Camera.from_table("P1", {"width": 4000, "height": 3000, **values})
    columns = int(np.ceil(images / 3))
    x = 22.0 * (np.arange(images) % columns)
    y = 35.0 * (np.arange(images) // columns)
    centre = np.column_stack([x, y, 80 + rng.normal(0, 2, images)])
    turned = np.pi * (np.arange(images) // columns % 2)
    down = rotation_from_vector(np.array([[np.pi, 0.0, 0.0]]))
    tilt = rotation_from_vector(rng.normal(0, 0.05, (images, 3)))
    about = rotation_from_vector(np.column_stack([np.zeros((images, 2)), turned]))
    rotation = tilt @ about @ down
    ground = np.column_stack(
        [
            rng.uniform(-25, x.max() + 25, points),
            rng.uniform(-20, y.max() + 20, points),
            rng.uniform(0, 12, points),
        ]
    )
    rows = []
    for i in range(images):
        pixel = project(ground, centre[i], rotation[i], camera.interior)
        ray = (ground - centre[i]) @ rotation[i].T
        # A far ray that the polynomial folds back into the picture is no observation.
        near = np.hypot(ray[:, 0], ray[:, 1]) < 0.75 * ray[:, 2]
        seen = near & (pixel >= 0).all(1) & (pixel < [4000, 3000]).all(1)
        rows += [(p, i, *pixel[p]) for p in np.flatnonzero(seen)]
    table = np.array(rows)
    image = table[:, 1].astype(int)
    several = np.bincount(table[:, 0].astype(int), minlength=points) >= 2
    kept = several[table[:, 0].astype(int)]
    table, image = table[kept], image[kept]
    point = table[:, 0].astype(int)
    image_names = [names.format(k) for k in range(images)]
    point_names = pd.Index([f"{k + 1}" if k >= 4 else f"GCP{k}" for k in range(points)])
    marks = point < 4
    used = np.flatnonzero(several)
    tables = {}
    for key, chosen in (("tie_points", ~marks), ("marks", marks)):
        found = observations_table(
            point[chosen], point_names, image[chosen], image_names, table[chosen, 2:]
        )
        found["point"] = found["point"].cat.remove_unused_categories()
        tables[key] = found
    pictures = pd.DataFrame(
        {"image": image_names, "camera": "P1", "time_s": 2.0 * np.arange(images)}
    )
    pictures[["x", "y", "z"]] = centre
    pictures[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(rotation)
    places = pd.DataFrame({"point": point_names[used]})
    places[["x", "y", "z"]] = ground[used]
    given = places[places["point"].str.startswith("GCP")].assign(role="control")
    return Block(
        name="exact", cameras={"P1": camera}, images=pictures, points=places,
        ground=given.reset_index(drop=True), **tables,
    )  # fmt: skip


@pytest.fixture(scope="session")
def fraser8():
    """Exact block of a camera with radial and decentring distortion."""
    return exact_block(k1=-0.06, k2=0.03, k3=-0.004, p1=0.0011, p2=-0.0007)


@pytest.fixture(scope="session")
def noisy():
    """The same with 0.6 px of noise: a good project as it comes out of a program."""
    block = exact_block(seed=3, points=400, k1=-0.06, k2=0.03, p1=0.0015, p2=-0.0009)
    rng = np.random.default_rng(1)
    for table in (block.tie_points, block.marks):
        table[["x", "y"]] += rng.normal(0, 0.6, (len(table), 2))
    return block
