"""Raw matches: some join images that do not see each other."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor.core.adjustment.adjusting import _misfits

DIKE = Path(__file__).parents[3] / "data_synthetic" / "dike"


@pytest.fixture(scope="module")
def dike():
    return corridor.read(DIKE)


@pytest.fixture(scope="module")
def sound(dike):
    return corridor.adjust(dike)


def with_false_matches(block, share, seed):
    """A share of the tie points is matched in the image that is farthest away too, anywhere."""
    rng = np.random.default_rng(seed)
    ties, names = block.tie_points, block.images["image"].astype(str).to_numpy()
    place = block.images[["x", "y"]].to_numpy(float)
    farthest = np.linalg.norm(place[:, None] - place, axis=2).argmax(axis=1)
    farthest = dict(zip(names, names[farthest], strict=True))
    first = ties.astype({"image": str, "point": str}).drop_duplicates("point")
    asked = first[rng.random(len(first)) < share]
    camera = next(iter(block.cameras.values()))
    false = pd.DataFrame(
        {"image": asked["image"].map(farthest), "point": asked["point"].to_numpy()}
    )
    false["x"] = rng.uniform(0.0, camera.width, len(false))
    false["y"] = rng.uniform(0.0, camera.height, len(false))
    both = pd.concat([ties.astype({"image": str, "point": str}), false], ignore_index=True)
    return block.with_(tie_points=both.drop_duplicates(["image", "point"]).reset_index(drop=True))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.01, 0.05, 0.25])
def test_false_matches_with_images_far_off_change_nothing(dike, sound, share):
    """One in a hundred led the block 370 m astray."""
    block = with_false_matches(dike, share, seed=1)
    assert len(block.tie_points) > len(dike.tie_points)
    found = corridor.adjust(block)
    off = found.block.images[["x", "y", "z"]] - sound.block.images[["x", "y", "z"]]
    assert 1e3 * np.abs(off.to_numpy()).max() < 1e-6
    (told,) = [note for note in found.warnings if "their matches are wrong" in note]
    assert told.startswith(f"{len(block.tie_points) - len(dike.tie_points)} tie point observations")


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["squares", "huber:2"])
@pytest.mark.parametrize("share, size_px", [(0.01, 100.0), (0.05, 300.0), (0.15, 30.0)])
def test_gross_measurements_are_left_out_and_told(dike, sound, share, size_px, loss):
    """One in a hundred, off by 100 px, moved images by 2.2 m beside a sigma naught of 26."""
    rng = np.random.default_rng(3)
    ties = dike.tie_points.copy()
    wrong = rng.random(len(ties)) < share
    ties.loc[wrong, ["x", "y"]] += rng.normal(0.0, size_px, (wrong.sum(), 2))
    camera = next(iter(dike.cameras.values()))
    ties["x"], ties["y"] = ties["x"].clip(1, camera.width - 1), ties["y"].clip(1, camera.height - 1)
    found = corridor.adjust(dike.with_(tie_points=ties), loss=loss)
    off = found.block.images[["x", "y", "z"]] - sound.block.images[["x", "y", "z"]]
    assert found.converged and found.sigma0 < 1.1
    assert np.abs(off.to_numpy()).max() < 0.05
    assert [note for note in found.warnings if "their matches are wrong" in note]


def test_a_few_gross_ones_that_the_rest_gets_over_are_left_out_and_no_model_is_blamed(dike, sound):
    """Thirty of 9,000 rays made a sigma naught of 2 of 1, and every standard deviation twice."""
    rng = np.random.default_rng(5)
    ties = dike.tie_points.copy()
    wrong = rng.choice(len(ties), 30, replace=False)
    ties.loc[wrong, ["x", "y"]] += rng.choice([-1.0, 1.0], (30, 2)) * rng.uniform(8, 16, (30, 2))
    found = corridor.adjust(dike.with_(tie_points=ties))
    assert found.sigma0 < 1.1 * sound.sigma0
    assert any("their matches are wrong" in note for note in found.notes)
    assert not any("the model lacks something" in told for told in found.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("bend_px", [20.0, 60.0])
def test_false_matches_are_left_out_of_a_block_whose_model_lacks_something_too(dike, bend_px):
    """Every second picture is bent the other way: the rest does not fit, and did not count."""
    camera = next(iter(dike.cameras.values()))

    def bent(block):
        ties = block.tie_points.copy()
        way = np.where(block.image_rows("tie_points") % 2, 1.0, -1.0)
        ties["x"] += way * bend_px * ((ties["y"] / camera.height - 0.5) ** 2 - 1 / 12)
        return block.with_(tie_points=ties)

    without = corridor.adjust(bent(dike))
    found = corridor.adjust(bent(with_false_matches(dike, 0.03, seed=2)))
    assert found.converged and found.sigma0 == pytest.approx(without.sigma0, rel=0.05)
    assert [note for note in found.warnings if "their matches are wrong" in note]
    assert found.check_rms.d3 < 1.1 * without.check_rms.d3


@pytest.mark.slow
def test_a_robust_loss_does_not_hide_that_measurements_are_gross(dike):
    """A diagnosis, which begins with one, kept false matches and missed a shutter beside them."""
    rng = np.random.default_rng(3)
    ties = dike.tie_points.copy()
    wrong = rng.random(len(ties)) < 0.01
    ties.loc[wrong, ["x", "y"]] += rng.normal(0.0, 100.0, (wrong.sum(), 2))
    found = corridor.adjust(dike.with_(tie_points=ties), loss="cauchy:2", strict=True)
    assert found.converged and found.sigma0 < 1.5
    assert _misfits(found)


MISTAKES = {
    "points of another image": (lambda xy, size: xy[::-1], "measured lies elsewhere"),
    "mirrored": (
        lambda xy, size: np.column_stack([size[0] - xy[:, 0], xy[:, 1]]),
        "measured lies elsewhere",
    ),
    "half as large": (lambda xy, size: xy / 2, "Another crop or size of the picture"),
}


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES)
def test_images_of_which_all_is_wrong_are_left_out_and_named(dike, sound, mistake):
    """Two of 42 drew the others 50 m along."""
    camera = next(iter(dike.cameras.values()))
    asked = dike.images["image"].astype(str).iloc[[10, 25]].tolist()
    tables, (change, words) = {}, MISTAKES[mistake]
    for table in ("tie_points", "marks"):
        rows = tables[table] = getattr(dike, table).copy()
        for image in asked:
            mine = (rows["image"] == image).to_numpy()
            xy = rows.loc[mine, ["x", "y"]].to_numpy()
            rows.loc[mine, ["x", "y"]] = change(xy, (camera.width, camera.height))
    found = corridor.adjust(dike.with_(**tables))
    before, after = (
        one.block.images.set_index(one.block.images["image"].astype(str))[["x", "y", "z"]]
        for one in (sound, found)
    )
    assert set(before.index) - set(after.index) == set(asked)
    assert np.abs(after - before.loc[after.index]).to_numpy().max() < 0.02
    (told,) = [note for note in found.warnings if words in note]
    assert all(image in told for image in asked)


def test_a_block_is_begun_from_the_images_that_are_adjusted(dike):
    """Some are left out on the way: what is begun again has no rows of them."""
    some = dike.images["image"].astype(str)[:12]
    found = corridor.adjust(dike.select(images=some))
    found.begun_from(dike)
    for table in ("images", "tie_points", "marks", "gnss"):
        assert set(getattr(found.start, table)["image"].astype(str)) <= set(some), table
    assert len(found.start.images) == 12
