"""The track that is shipped to try `corridor gnss` with."""

import json
from pathlib import Path

import numpy as np
from scipy.stats import chi2

import corridor
from corridor.core import gnss
from corridor.core.geometry import rotation_from_quaternion

DATA = Path(__file__).parents[3] / "data_synthetic"


def test_antennas_found_in_it_miss_the_true_ones_by_their_sigmas():
    """126 coordinates: the sum of their squares in sigmas is a chi-square."""
    block = corridor.read(DATA / "dike")
    found = gnss.antenna(
        gnss.read_track(DATA / "dike_track.csv"), gnss.read_exposures(DATA / "dike")
    ).gnss
    truth = json.loads((DATA / "dike.truth.json").read_text(encoding="utf-8"))
    rotation = rotation_from_quaternion(
        np.array([truth["quaternion"][name] for name in found["image"]])
    )
    flight = dict(zip(block.images["image"], block.images["flight"], strict=True))
    arm = np.array([truth["lever_arm"][flight[name]] for name in found["image"]])
    true = np.array([truth["centre"][name] for name in found["image"]])
    true += np.einsum("nji,nj->ni", rotation, arm)
    missed = (found[["x", "y", "z"]] - true) / found[["sx", "sy", "sz"]].to_numpy()
    square = float(np.square(missed.to_numpy()).sum())
    low, high = chi2.interval(0.999, missed.size)
    assert len(found) == 42 and low < square < high
