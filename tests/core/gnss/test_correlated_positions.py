"""Correlations of positions, from a program's file to the block, turned with their axes."""

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor.core.block import RHO, correlations, covariances, made_possible, possible
from corridor.core.gnss import Exposures, about_the_middle, antenna, interpolate, read_track

HEADER = """% program   : RTKPOST ver.2.4.3
%  GPST                  e-baseline(m)  n-baseline(m)  u-baseline(m)   Q  ns   sde(m)   sdn(m) \
  sdu(m)  sden(m)  sdnu(m)  sdue(m) age(s)  ratio
"""


def pos_file(path, roots=(-0.005, -0.007, 0.006), sigma=(0.008, 0.012, 0.025)):
    rows = []
    for k in range(60):
        second = k * 0.2
        where = f"{5 * second:.4f} {0.02 * second:.4f} {50 + 0.1 * np.sin(second):.4f}"
        spread = " ".join(f"{value:.4f}" for value in (*sigma, *roots))
        rows.append(f"2024/06/24 10:00:{second:06.3f} {where} 1 12 {spread} 0.0 99.0")
    path.write_text(HEADER + "\n".join(rows) + "\n")
    return path


def test_signed_roots_become_correlations_at_the_exposures(tmp_path):
    """cov = v |v|: -25e-6 / (8 mm 12 mm), 36e-6 / (8 mm 25 mm), -49e-6 / (12 mm 25 mm), by hand."""
    track = read_track(pos_file(tmp_path / "a.pos"))
    times = pd.DataFrame(
        {"image": ["A", "B"], "time_s": track.table["time_s"].iloc[[20, 40]] + 0.07}
    )
    exposures = Exposures(times, track.day, track.time_system, None, tmp_path / "images.csv")
    gnss = antenna(track, exposures).gnss
    expected = [-25e-6 / 96e-6, 36e-6 / 200e-6, -49e-6 / 300e-6]
    assert gnss[list(RHO)].to_numpy() == pytest.approx(np.tile(expected, (2, 1)), abs=1e-9)


def test_printed_digits_that_leave_no_covariance_are_taken_nearer_to_zero(tmp_path):
    """Three signed roots as large as their sigmas: printed 0.0080 each, no matrix is so."""
    track = read_track(
        pos_file(tmp_path / "a.pos", roots=(-0.008, -0.008, -0.008), sigma=(0.008, 0.008, 0.008))
    )
    rho = track.table[list(RHO)].to_numpy()
    assert possible(rho).all() and (rho < -0.45).all()


def test_a_correlation_that_is_possible_stays_bit_for_bit():
    random = np.random.default_rng(0)
    a = random.standard_normal((50, 3, 3))
    rho = correlations(a @ a.transpose(0, 2, 1) + 0.2 * np.eye(3))
    assert (made_possible(rho) == rho).all()
    assert possible(rho).all()


def test_between_epochs_correlations_are_interpolated():
    time = np.arange(0.0, 20.0, 0.5)
    track = pd.DataFrame({"time_s": time, "x": 5 * time, "y": 0 * time, "z": 50 + 0 * time})
    track[["sx", "sy", "sz"]] = [0.01, 0.01, 0.02]
    track[list(RHO)] = np.stack([time / 40, 0 * time, -time / 40], axis=1)
    found = interpolate(track, np.array([5.3, 12.0])).table
    assert found["rho_xy"].tolist() == pytest.approx([5.3 / 40, 12 / 40])
    assert found["rho_yz"].tolist() == pytest.approx([-5.3 / 40, -12 / 40])


def test_axes_that_turn_take_covariances_with_them():
    """From a grid to the local frame about the middle: a turn by the convergence of the meridian,
    0.9 degrees; the covariance matrix is turned as a whole."""
    block = corridor.Block(
        name="b",
        cameras={"C": corridor.Camera.from_table("C", {"width": 100, "height": 80, "f": 100})},
        images=pd.DataFrame({"image": list("ABC"), "camera": "C"}),
        gnss=pd.DataFrame(
            {
                "image": list("ABC"), "x": [600000.0, 600050, 600100],
                "y": [5000000.0, 5000010, 5000000], "z": 100.0,
                "sx": 0.01, "sy": 0.03, "sz": 0.05,
                "rho_xy": 0.6, "rho_xz": -0.2, "rho_yz": 0.1,
            }
        ),
        crs="EPSG:32631",
    )  # fmt: skip
    from corridor.tools.formats.frames import moved

    made = moved(block, about_the_middle(block), "EPSG:32631")
    before = covariances(block.gnss_sigma(), block.correlation("gnss"))
    after = covariances(made.gnss_sigma(), made.correlation("gnss"))
    for one, other in zip(before, after, strict=True):
        assert np.linalg.eigvalsh(other) == pytest.approx(np.linalg.eigvalsh(one), rel=1e-6)
        assert np.abs(other - one).max() > 1e-6
