"""The surveys of table 7.2 with the readout of the Mavic 2 Pro: what each cure brings."""

from dataclasses import replace

import numpy as np
import pytest
from kit.table_7_3 import configurations, in_pairs

from corridor.core.simulation import read_plan, simulate

# An image, as few as a reduction of tie points leaves (Zhou 2019, section 7.6.4.1). More of them
# make motions of single images less harmful: with 300 they are no worse than the shutter.
TIES = 150
VALUES = {"rolling_shutter": {"readout": 0.0564}}


def flown(name, seed, ties):
    plan = read_plan(name)
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=ties))
    block = simulate(plan, seed=seed).copy()
    block.images = block.images.drop(columns=["vx", "vy", "vz", "wx", "wy", "wz"])
    block.images["time_s"] = np.floor(block.images["time_s"])
    return block


def gains(name, ties, seeds, rows, **options):
    """Median over the seeds of the gain (%) in each row."""
    runs = [
        configurations(flown(name, s, ties), VALUES, cameras={"8p": "fraser8"}, **options)
        for s in seeds
    ]
    return np.median([[run.row(row)["gain"] for row in rows] for run in runs], axis=0)


def test_pairs_hold_the_tilt_across_and_odd_and_even_would_not():
    first, second = in_pairs([f"P{k}" for k in range(8)])
    assert (first, second) == (["P0", "P1", "P4", "P5"], ["P2", "P3", "P6", "P7"])


def test_every_configuration_of_table_7_3_is_there():
    found = configurations(flown("thesis_viabon_n90", 0, 60), VALUES)
    names = {f"{o}-{p}-GCP{k}" for o in "oc" for p in ("8p", "10p") for k in (1, 2)}
    assert set(found.table.index) == set(found.adjustments) == names
    row = found.row("o-8p-GCP1")
    assert row["gain"] == 0
    assert row["rms_3d"] == pytest.approx(np.hypot(row["rms_xy"], row["rms_z"]))
    # Published: 14.1 and 13.9 cm in plan (table 7.5).
    assert 9 < row["rms_xy"] < 20
    assert found.row("c-8p-GCP1")["rms_xy"] < 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [("thesis_viabon_n30", 80), ("thesis_viabon_n90", 80), ("thesis_viabon_n40", 45)],
)
def test_two_steps_bring_the_centimetres_back(name, least):
    """Issue 10, Must 3: at least 80 % in the blocks, 45 % in the corridor; three seeds."""
    rows = ["s-8p-GCP1", "s-8p-GCP2"]
    found = gains(name, TIES, range(3), rows, corrected={"s": "strip"})
    assert found.min() >= least


@pytest.mark.slow
def test_a_motion_for_every_image_makes_the_corridor_worse():
    """Issue 10, Must 3; published -139 to -487 % and -220 to -444 % (tables 7.11, 7.15).

    RMS of all check points of three seeds and both control sets: single ones scatter.
    """
    squares = {"o": [], "m": []}
    for seed in range(3):
        found = configurations(
            flown("thesis_viabon_n40", seed, TIES), VALUES, cameras={"8p": "fraser8"},
            corrected={}, per_image="motion_per_image",
        )  # fmt: skip
        for kind, mine in squares.items():
            mine += [found.row(f"{kind}-8p-GCP{k}")["rms_3d"] ** 2 for k in (1, 2)]
    assert np.mean(squares["m"]) > 1.5**2 * np.mean(squares["o"])
