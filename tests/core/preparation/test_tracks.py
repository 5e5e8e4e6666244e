"""Two drones in one list of images are told, and no velocity is derived across them."""

import numpy as np
import pandas as pd
import pytest

from corridor import prepare
from corridor.core.block import Block
from corridor.core.camera import Camera
from corridor.core.preparation import derived, derived_table
from corridor.core.preparation.tracks import interleaved


def flight(start, count=12, speed=5.0, seed=0, noise=0.02):
    """Times (n,) and positions (n, 3) of a drone that flies to and fro in two strips."""
    rng = np.random.default_rng(seed)
    time = 2.0 * np.arange(count)
    half = count // 2
    along = np.r_[np.arange(half), np.arange(count - half)[::-1]] * 2.0 * speed
    across = np.r_[np.zeros(half), np.full(count - half, 15.0)]
    place = np.column_stack([along, across, np.full(count, 60.0)]) + start
    return time, place + rng.normal(0, noise, place.shape)


def block_of(flights, names, **columns):
    """Images with times and GNSS positions, in the order of their names."""
    time = np.concatenate([t for t, _ in flights])
    place = np.concatenate([p for _, p in flights])
    images = pd.DataFrame({"image": names, "camera": "A", "time_s": time, **columns})
    gnss = pd.DataFrame({"image": names, **dict(zip("xyz", place.T, strict=True))})
    camera = Camera.from_table("A", {"width": 4000, "height": 3000, "f": 3600.0})
    ties = pd.DataFrame({"point": ["p"], "image": [names[0]], "x": [5.0], "y": [5.0]})
    return Block(name="two", cameras={"A": camera}, images=images, gnss=gnss, tie_points=ties)


def two(late=1.0, aside=(0.0, 20.0, 0.0), count=12):
    one, other = flight([0, 0, 0], count), flight(aside, count, seed=1)
    return [one, (other[0] + late, other[1])]


def numbered(*prefixes, count=12, first=(1, 500, 900)):
    return [f"{p}_{f + k:04d}.JPG" for p, f in zip(prefixes, first, strict=False)
            for k in range(count)]  # fmt: skip


@pytest.mark.parametrize("late", [1.0, 0.1])
@pytest.mark.parametrize("aside", [(0, 20, 0), (0, 8, 0), (0, 0, 40), (300, 100, 10)])
@pytest.mark.parametrize("names", [numbered("A", "B"), numbered("DJI", "DJI")])
def test_two_drones_that_names_tell_apart_become_two_flights(late, aside, names):
    made = prepare(block_of(two(late, aside), names))
    assert made.block.images["flight"].tolist() == ["track 1"] * 12 + ["track 2"] * 12
    (one,) = [d for d in derived(made.block) if d.column == "images.flight"]
    assert "2 drones" in one.sentence and one.witnesses[0].says == "agrees"
    speed = np.linalg.norm(made.block.numbers("images", "vx", "vy", "vz"), axis=1)
    assert np.median(speed) == pytest.approx(5.0, abs=0.5) and speed.max() < 20


def test_two_drones_that_only_positions_tell_apart_get_no_velocity():
    flights = two()
    order = np.argsort(np.concatenate([t for t, _ in flights]), kind="stable")
    names = np.empty(24, object)
    names[order] = [f"IMG_{k:04d}.JPG" for k in range(24)]
    made = prepare(block_of(flights, list(names)))
    assert not made.block.has("images.vx") and not made.block.has("images.flight")
    (note,) = made.notes
    assert "2 drones" in note and "column flight" in note and "21 m apart" in note


def test_three_drones_are_three():
    flights = [flight([0, 30.0 * k, 0], seed=k) for k in range(3)]
    flights = [(t + 0.6 * k, p) for k, (t, p) in enumerate(flights)]
    made = prepare(block_of(flights, numbered("A", "B", "C")))
    assert made.block.images["flight"].nunique() == 3


@pytest.mark.parametrize("noise", [0.02, 0.5, 2.0])
@pytest.mark.parametrize("speed", [0.0, 2.0, 10.0])
def test_one_drone_is_one(speed, noise):
    block = block_of([flight([0, 0, 0], 40, speed, noise=noise)], numbered("A", count=40))
    assert interleaved(block) is None


def test_long_flights_are_looked_at_quickly_and_rightly():
    one = flight([0, 0, 0], 2500)
    assert interleaved(block_of([one], numbered("A", count=2500))) is None
    pair = two(1.0, (0, 40, 0), 1500)
    order = np.argsort(np.concatenate([t for t, _ in pair]), kind="stable")
    names = np.empty(3000, object)
    names[order] = [f"IMG_{k:04d}.JPG" for k in range(3000)]
    found = interleaved(block_of(pair, list(names)))
    assert np.array_equal(found.track, np.arange(3000) >= 1500) and not found.named


def test_two_flights_one_after_the_other_are_no_two_drones():
    one, other = two()
    other = other[0] + 600.0, other[1] + [900.0, 0, 0]
    assert interleaved(block_of([one, other], numbered("A", "B"))) is None


def test_flights_that_images_csv_names_are_kept():
    named = ["a"] * 12 + ["b"] * 12
    made = prepare(block_of(two(), numbered("A", "B"), flight=named))
    assert made.block.images["flight"].tolist() == named and made.block.has("images.vx")


def test_what_is_derived_is_one_table_with_its_witnesses():
    table = str(derived_table(prepare(block_of(two(), numbered("A", "B"))).block))
    assert "images.vx, vy, vz" in table and "images.flight" in table
    assert "positions agrees" in table and "cannot be checked" in table
