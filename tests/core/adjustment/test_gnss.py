"""Antenna positions in the adjustment: false fixes, clocks, and what they correlate with."""

from dataclasses import replace

import numpy as np
import pytest

import corridor
from corridor.core.adjustment.tables import _threes
from corridor.core.simulation import read_plan

CLOCK = 0.020


def flown(name="thesis_s1_n50", images=90, per_image=150, seed=1, effects=None):
    """A shorter flight of the same kind: base and noise as in chapter 5 of Zhou 2019."""
    plan = read_plan(name)
    plan = replace(plan, tie_points=replace(plan.tie_points, per_image=per_image))
    share = images / plan.flights[0].images
    plan = replace(plan, axis_m=((0.0, 0.0), (0.0, 600.0 * share))).with_flights(images=images)
    return corridor.simulate(plan, effects, seed=seed)


@pytest.fixture(scope="module")
def clean():
    return flown()


@pytest.fixture(scope="module")
def dirty(clean):
    """Six positions 19 cm off in any direction, ten to twenty of their sigmas."""
    block, draw = clean.copy(), np.random.default_rng(0)
    rows = draw.choice(len(block.gnss), 6, replace=False)
    off = draw.standard_normal((6, 3))
    block.gnss.loc[rows, ["x", "y", "z"]] += 0.19 * off / np.linalg.norm(off, axis=1)[:, None]
    return block, set(block.gnss["image"].iloc[rows])


class TestFalseFixes:
    def test_all_are_rejected_and_nothing_else(self, dirty):
        block, false = dirty
        kept = corridor.adjust(block, reject_gnss=True).residuals["gnss"]["image"]
        assert set(block.gnss["image"]) - set(kept) == false

    def test_heights_come_back_to_within_a_millimetre(self, clean, dirty):
        """The effect of the false fixes on the check points is several times larger."""
        good = corridor.adjust(clean).check_points["dz"]
        bad = corridor.adjust(dirty[0], weights="stated").check_points["dz"]
        mended = corridor.adjust(dirty[0], reject_gnss=True).check_points["dz"]
        # Six of ninety weights are gone: a fifteenth of the noise of 10 mm over sqrt(90).
        assert np.abs(mended - good).max() < 1e-3
        assert np.abs(bad - good).max() > 2 * np.abs(mended - good).max()

    def test_the_report_says_how_many_and_which(self, dirty):
        block, false = dirty
        first = corridor.adjust(block, reject_gnss=True).warnings[0]
        assert first.startswith("6 antenna positions rejected as false fixes, residual up to 0.")
        assert sum(name in first for name in false) == 5

    def test_without_the_option_they_stay_and_the_report_names_the_remedy(self, dirty):
        adjusted = corridor.adjust(dirty[0])
        assert len(adjusted.residuals["gnss"]) == 90
        assert any("--reject-gnss" in sentence for sentence in adjusted.warnings)

    def test_a_clean_block_loses_nothing(self, clean):
        assert len(corridor.adjust(clean, reject_gnss=True).residuals["gnss"]) == 90


class TestClock:
    """20 ms at some 2 m/s are 4 cm along the track."""

    @pytest.mark.parametrize("arm", ["free", "fixed"])
    def test_an_offset_is_found_within_three_sigmas(self, arm):
        block = flown(effects={"clock_offset": {"offset": CLOCK}})
        block.lever_arm = {"s1-n50": read_plan("thesis_s1_n50").flights[0].lever_arm_m}
        row = corridor.adjust(block, effects=["clock_offset"], lever_arm=arm).effects.iloc[0]
        assert abs(row["value"] - CLOCK) < 3 * row["sigma"]
        # With the arm free only gusts tell clock from arm where headings turn: by hand, 9 mm of
        # noise over 0.1 m/s of gusts and the root of 90 images is 9 ms; control and images help.
        assert row["sigma"] < (9e-3 if arm == "free" else 2e-3)


@pytest.fixture(scope="module")
def pairs(clean):
    return corridor.adjust(clean, control=[]).correlations.set_index(["a", "b"]).T


class TestCorrelations:
    def test_without_control_lever_arm_and_camera_height_are_one(self, pairs):
        """Thesis, table 5.3: 0.99 in every row without control."""
        assert pairs["lever_arm.s1-n50.z", "height"]["mean"] > 0.97

    def test_sigmas_stand_beside_the_coefficient(self, clean, pairs):
        pair = pairs["camera.camlight.f", "height"]
        adjusted = corridor.adjust(clean, control=[])
        focal = adjusted.camera.set_index("parameter").sigma["f"]
        assert pair["sigma_a"] == pytest.approx(focal, rel=1e-9)
        # The mean of the poses' sigmas, in metres.
        assert pair["sigma_b"] == pytest.approx(adjusted.poses["sz"].mean(), rel=1e-9)

    def test_flights_are_told_apart(self):
        plan = read_plan("thesis_50vt+thesis_50ob")
        plan = replace(plan, gnss=True, tie_points=replace(plan.tie_points, per_image=60))
        names = set(corridor.adjust(corridor.simulate(plan)).correlations["b"])
        assert {"height", "height.50vt", "height.50ob"} <= names


def test_a_missing_shutter_of_an_even_flight_is_no_other_datum():
    """A camera that always looks the same way in still air: its free arm is any vector, by which
    all ground points seemed to lie elsewhere, and the block was refused."""
    plan = read_plan("data_synthetic/dike.toml").with_flights(
        heading="kept", attitude_jitter_deg=0.0, velocity_jitter_m_s=0.0, angular_rate_deg_s=0.0,
        wind_m_s=0.0,
    )  # fmt: skip
    for seed in range(2):
        block = corridor.simulate(plan, {"rolling_shutter": {"readout": 0.025}}, seed=seed)
        found = corridor.adjust(block, camera="fraser10")
        assert found.converged and found.sigma0 > 1.2
        assert any("residuals contradict" in told for told in found.warnings)


@pytest.mark.parametrize("factor, told", [([0.3, 0.8, 2.0], False), ([1.0, 1.0, 1000.0], True)])
def test_positions_of_uneven_axes_are_no_outliers_and_absurd_sigmas_are_told(factor, told):
    """12 of 29 sound ones were, by the scatter of all axes together; 100 draws of 29."""
    rng = np.random.default_rng(7)
    named = 0
    for _ in range(100):
        residual = 0.02 * rng.normal(size=(29, 3)) * factor
        table = _threes(
            range(29), "image", residual, residual, np.full((29, 3), 0.02**-2), apart=True
        )
        named += int(table["outlier"].sum())
    assert named > 2000 if told else named <= 3
