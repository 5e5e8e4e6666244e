"""Real strips flown minutes apart: nothing moved, and what is put in is found.

saraburi/flight2: strips S11 and S13 against S12 and S14, 59 % overlap across, five ground points.
special_plot: strips 1, 3, 5 against 2 and 4, GNSS of metres and no ground point.
"""

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor.tools.change import Settlement, moved_ground

pytestmark = pytest.mark.slow


def strips(block, names):
    """The block of some strips: their images, and tie points that two of them still show."""
    part = block.copy()
    kept = set(part.images.loc[part.images["strip"].isin(names), "image"])
    for table in ("images", "tie_points", "marks", "gnss"):
        rows = getattr(part, table)
        setattr(part, table, rows[rows["image"].isin(kept)].reset_index(drop=True))
    count = part.tie_points["point"].map(part.tie_points["point"].value_counts())
    part.tie_points = part.tie_points[count > 1].reset_index(drop=True)
    return part


@pytest.fixture(scope="module")
def dates(real_data):
    block = corridor.read(real_data / "saraburi" / "flight2")
    return strips(block, ["S11", "S13"]), strips(block, ["S12", "S14"])


@pytest.fixture(scope="module")
def adjusted(dates):
    return tuple(corridor.adjust(block) for block in dates)


@pytest.mark.parametrize("same_ties", [True, False])
def test_nothing_moved_in_minutes(adjusted, same_ties):
    found = corridor.change(*adjusted, same_ties=same_ties)
    assert found.verdict == "nothing"
    assert not found.surface.moved.any() and not found.points.moved.any()


def between_strips(block):
    """Which tie observations (n,) are of points that two strips show."""
    strip = block.tie_points["image"].map(block.images.set_index("image")["strip"])
    return strip.groupby(block.tie_points["point"]).transform("nunique").to_numpy() > 1


def test_what_hangs_on_matches_between_strips_is_as_uncertain_as_they_are(dates, adjusted):
    """GCP10 goes down by 236 mm, and all surface around it. 3 to 5 % of the tie points, at the rims
    of the pictures, tie the two strips of a date together. A match is off by the same in all
    pictures of a strip: the means of the strips scatter by twice what free errors would, and
    nothing is significant. Without these matches nothing is left, there or elsewhere.
    """
    apart = []
    for block in dates:
        shared = between_strips(block)
        part = block.copy()
        part.tie_points = part.tie_points[~shared].reset_index(drop=True)
        apart.append(corridor.adjust(part))
    with_them = corridor.change(*adjusted, same_ties=True, camera=False)
    without = corridor.change(*apart, same_ties=True, camera=False)
    assert [epoch.overdispersion > 1.9 for epoch in with_them.final.joint.epochs] == [True, True]
    assert max(epoch.overdispersion for epoch in without.final.joint.epochs) < 1.5
    assert "times as uncertain as within" in " ".join(str(with_them).split())
    for found in (with_them, without):
        assert found.points.probability[~found.points.held].min() > 0.1
        assert found.verdict == "nothing" and not found.surface.moved.any()
        spread = np.sqrt(np.mean((found.surface.distance / found.surface.total) ** 2))
        # Never too small; what is shared errs alike, and one draw of it may be small.
        assert spread < 1.05


@pytest.fixture(scope="module")
def five_strips(real_data):
    """The special plot by strips, every second of them; speeds as the photographs state them.

    Its GNSS of metres and five parallel strips tell no focal length, which is 1110 to 1160 px.
    """
    block = corridor.read(real_data / "special_plot" / "block")
    told = pd.read_csv(real_data / "special_plot" / "metadata.csv").set_index("image")
    told = told.loc[block.images["image"]]
    for axis, column, sign in (("vx", "east", 1), ("vy", "north", 1), ("vz", "down", -1)):
        block.images[axis] = sign * told[f"speed_{column}"].to_numpy(float)
    easting = block.images["x"].to_numpy()[:, None]
    block.images["strip"] = np.array(list("ABCDE"))[
        np.argmin(np.abs(easting - [-53.0, -27.5, -3.7, 21.3, 44.8]), axis=1)
    ]
    return strips(block, ["A", "C", "E"]), strips(block, ["B", "D"])


@pytest.mark.parametrize(
    "options",
    [{"same_ties": True}, {}, {"same_ties": True, "together": True, "same_camera": True}],
    ids=lambda options: ", ".join(options) or "default",
)
def test_dates_on_gnss_of_metres_are_laid_together_and_nothing_moved(five_strips, options):
    model = corridor.Model(priors={"camera.1.f": (1135.0, 25.0)})
    found = corridor.change(*five_strips, model=model, **options)
    assert found.asked.datum == "stable" and found.verdict == "nothing"
    assert not found.surface.moved.any()
    assert "aligned on what stands still" in str(found)


@pytest.mark.parametrize("depth", [0.02, 0.05])
def test_a_patch_that_sinks_is_found_in_size_and_place(dates, adjusted, depth):
    """Away from the control that is held: the step of the surface is the one put in."""
    place = (204.5, 152.3)
    truth = adjusted[1].block
    sunk = moved_ground(truth, Settlement(place, 70.0, depth, 0.2), survey=False)
    block = dates[1].copy()
    for table in ("tie_points", "marks"):
        rows = getattr(block, table)
        step = getattr(sunk, table)[["x", "y"]].to_numpy(float)
        step = step - getattr(truth, table)[["x", "y"]].to_numpy(float)
        rows[["x", "y"]] = rows[["x", "y"]].to_numpy(float) + step
    options = {"same_ties": True, "camera": False, "spacing": 9.8}
    before = corridor.change(*adjusted, **options).surface
    found = corridor.change(adjusted[0], corridor.adjust(block), **options)
    # As much as a bent block shows is not said to be the one point's motion.
    assert found.verdict == "nothing"
    after = found.surface
    assert len(before) == len(after)
    away = np.linalg.norm(after.cores.xyz[:, :2] - place, axis=1)
    step = after.distance - before.distance
    inside = away < 56.0 - after.cores.radius
    assert inside.sum() > 10
    # The noise is the same both times: what is left is what the motion does to the camera.
    np.testing.assert_allclose(step[inside], -depth, atol=0.05 * depth)
    assert np.abs(step[away > 70.0 + after.cores.radius]).max() < 0.05 * depth
    assert np.abs(step[inside] + depth).max() < np.median(after.sigma[inside])
