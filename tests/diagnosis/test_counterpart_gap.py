"""Bands are honest where nothing is missing, and a gap opens where something is."""

from types import SimpleNamespace

import numpy as np
import pytest
from believing import believed, flown

from corridor import diagnosis
from corridor.core.effects import every_effect
from corridor.diagnosis.bootstrap.statistics import Statistic


def made_up(measured, simulated, absorbed=None):
    """Counterparts of one curve that were never adjusted."""
    count = len(measured)
    return SimpleNamespace(
        statistics=[Statistic("curve", "tie", "px", "row", np.arange(float(count)))],
        measured=np.asarray(measured, float),
        simulated=np.asarray(simulated, float),
        absorbed=np.zeros(count, bool) if absorbed is None else absorbed,
        missing={}, unseen=(),
        replicator=SimpleNamespace(system=SimpleNamespace(block=SimpleNamespace(name="made up"))),
    )  # fmt: skip


class TestBand:
    @pytest.mark.parametrize("count", [20, 39])
    @pytest.mark.parametrize("kind", ["normal", "correlated", "heavy"])
    def test_one_curve_in_twenty_leaves_it_whatever_its_distribution(self, kind, count):
        """1,000 draws: 5 % and three standard errors of 0.7 % at most, and not half of it."""
        draw = np.random.default_rng(4)
        left = 0
        for _ in range(1000):
            curves = draw.standard_normal((count + 1, 12))
            if kind == "correlated":
                curves += 3 * draw.standard_normal((count + 1, 1))
            if kind == "heavy":
                curves = draw.standard_t(3, (count + 1, 12))
            left += diagnosis.compare(made_up(curves[0], curves[1:])).share
        assert 0.02 < left / 1000 < 0.071

    def test_the_gap_is_what_sticks_out(self):
        """One value 10 deviations out: (10 - limit) squared, less chance."""
        draw = np.random.default_rng(4)
        simulated = draw.standard_normal((400, 3))
        simulated = (simulated - simulated.mean(axis=0)) / simulated.std(axis=0, ddof=1)
        (one,) = diagnosis.compare(made_up([0.0, 10.0, 0.0], simulated)).statistics
        assert one.leaves and one.outside.tolist() == [False, True, False]
        # A new value misses the mean of 400 by sqrt(1 + 1/400).
        assert one.excess == pytest.approx((10 / np.sqrt(1 + 1 / 400) - one.limit) ** 2)
        # One in twenty of 400 curves of three: two-sided, at 1 - 0.05/3.
        assert one.limit == pytest.approx(2.39, abs=0.2)

    def test_nothing_sticks_out_of_a_curve_inside(self):
        simulated = np.random.default_rng(1).standard_normal((39, 5))
        assert diagnosis.compare(made_up(np.zeros(5), simulated)).gap == 0.0

    def test_what_is_absorbed_cannot_leave(self):
        simulated = 1e-12 * np.random.default_rng(1).standard_normal((39, 2))
        absorbed = np.array([True, True])
        compared = diagnosis.compare(made_up([1e-9, 0.0], simulated, absorbed))
        assert not compared.leaving and compared.gap == 0.0


# What a flight without attitudes, rigs and distances can show; the tests of these have the others.
PLAIN = [
    effect.slug
    for effect in every_effect()
    if not effect.generic
    and not {"attitudes.image", "rig.member", "distances.distance"} & set(effect.needs)
]


class TestNothingIsMissing:
    @pytest.mark.slow
    def test_about_one_statistic_in_twenty_leaves(self):
        """Three blocks, some 70 statistics each, that go together: twice 5 % is still chance."""
        shares = [share_that_leaves(seed, count=19) for seed in range(3)]
        assert np.mean(shares) < 0.10

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", ["clean", "outliers", "heavy", "rough", "slow"])
    def test_six_blocks_of_each_kind(self, kind):
        """5 %, and what six blocks scatter; `benchmarks/counterparts.py` takes thirty."""
        shares = [share_that_leaves(seed, kind, count=19) for seed in range(100, 106)]
        assert np.mean(shares) < 0.09


def share_that_leaves(seed, kind="clean", count=39):
    noise = {
        "outliers": {"outliers": 0.05},
        "rough": {"tie_px": 0.5},
        "slow": {"gnss_slow": 0.6, "gnss_slow_s": 30.0},
        "heavy": {"tie_px": 0.0},
    }.get(kind, {})
    block = flown(seed=seed, noise=noise)
    if kind == "heavy":
        draw = np.random.default_rng(seed)
        observed = len(block.tie_points)
        scale = 0.2 * np.exp(0.5 * draw.standard_normal(observed))
        scale /= np.sqrt(draw.chisquare(4, observed) / 4)
        xy = block.tie_points[["x", "y"]].to_numpy()
        xy = xy + scale[:, None] * draw.standard_normal((observed, 2))
        block.tie_points = block.tie_points.assign(x=xy[:, 0], y=xy[:, 1])
        block.sigma["tie_px"] = 0.3
    return diagnosis.compare(diagnosis.counterparts(believed(block), count, seed)).share


class TestSomethingIsMissing:
    @pytest.mark.parametrize(
        "slug, values, calibrated",
        [
            ("rolling_shutter", {"readout": 0.025}, False),
            pytest.param("focal_drift", {"rate": 0.05}, False, marks=pytest.mark.slow),
            pytest.param("lever_arm", {"x": 0.05, "z": 0.05}, True, marks=pytest.mark.slow),
        ],
    )
    def test_the_gap_is_seen_and_falls_by_nine_tenths(self, slug, values, calibrated):
        block = flown({slug: values}, calibrated=calibrated)
        arm = "fixed" if slug == "lever_arm" else None
        cases = [believed(block, *with_it, lever_arm=arm) for with_it in ((), (slug,))]
        row = (cases[1].effects["value"] / cases[1].effects["sigma"]).abs()
        assert row.max() > 8
        gap = diagnosis.Closing(
            *(diagnosis.compare(diagnosis.counterparts(case, 20)) for case in cases)
        )
        assert gap.before.leaving
        assert gap.closed >= 0.9
        assert gap.before["signatures of the physical effects"].leaves
        assert "the gap falls from" in str(gap)
        assert gap.table["excess_before"].sum() > 10 * gap.table["excess_after"].sum()

    @pytest.mark.slow
    @pytest.mark.parametrize("slug", PLAIN)
    def test_of_ratio_ten_every_effect_of_the_catalogue(self, slug):
        """Nine tenths of the gap close in two of three draws, but where noise explains as much.

        One of twenty statistics leaves its band by chance, and a strong one that does leaves a gap.
        What wanders slowly passes for noise of the GNSS, of which the size is estimated: where that
        takes it up, the gap before is that of one statistic a deviation outside, or none.
        """
        if slug == "time_rounding":
            pytest.skip("rounded times are noise of the antenna, whose size is estimated")
        closed = []
        for seed in (3, 4, 5):
            made = ratio_ten(slug, seed)
            before, after = (diagnosis.compare(one) for one in made)
            noise = made[0].replicator.noise.gnss
            assert before.leaving or (noise.coloured > np.median(noise.stated)).any()
            closed.append(diagnosis.Closing(before, after).closed >= 0.9 or before.gap < 1.0)
            if closed.count(True) == 2:
                break
        assert closed.count(True) == 2


HELD = {
    "focal", "focal_per_flight", "principal_point_per_flight", "radial_distortion",
    "radial_distortion_per_flight",
    "decentring_distortion", "affine_distortion", "sensor_unflatness",
}  # fmt: skip


def ratio_ten(slug, seed=3):
    """Counterparts before and after an effect whose signal is ten times its standard deviation."""
    # Check points of the same survey would move with the control.
    options = {"calibrated": slug in HELD, "seed": seed, "apart": slug == "control_datum"}
    if slug in ("earth_curvature", "refraction"):
        options |= {"height": 3000.0, "interval_s": 8.0}
    # Antenna and arm look alike while the arm is free; this one is known.
    arm = "fixed" if slug in ("lever_arm", "lever_arm_per_flight", "gnss_bias") else None
    if slug == "water_refraction":
        options["constants"] = {slug: {"level": 1.0}}
    clean = flown(**options)
    with_it = believed(clean, slug, lever_arm=arm)
    member = with_it.problem.stack.members[slug]
    draw = np.random.default_rng(seed)
    values = draw.standard_normal(member.shape) * [p.scale for p in member.parameters]
    if member.effect.group in ("point", "survey"):
        values[np.array(member.groups) != member.groups[0]] = 0.0
    labels = [(n, u.at) for n, u in enumerate(with_it.problem.unknowns) if u.owner == slug]
    if labels:
        rows = [n for n, _ in labels]
        covariance = with_it.covariance.shared[np.ix_(rows, rows)]
        vector = np.array([values[at] for _, at in labels])
        ratio = np.sqrt(vector @ np.linalg.solve(covariance, vector))
    else:
        sigma = with_it.effects["sigma"].to_numpy().reshape(values.shape)
        ratio = np.sqrt(((values / sigma) ** 2).sum())
    block = flown({slug: values * 10 / ratio}, **options)
    return [
        diagnosis.counterparts(believed(block, *effects, lever_arm=arm))
        for effects in ((), (slug,))
    ]
