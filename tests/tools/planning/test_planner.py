"""The planner against the adjustment itself, and what it says of hand-made cases."""

from dataclasses import replace

import numpy as np
import pytest
from small_plans import LOW_HIGH, NADIR, OBLIQUE, SIGMAS, plan_of, quickest

import corridor
from corridor.core.adjustment import Model
from corridor.core.errors import InputError
from corridor.core.simulation import Ground
from corridor.tools.planning import GnssNoise, Planner, Surveyed
from corridor.tools.planning.detection import detectable
from corridor.tools.planning.planner import Believed

QUIET = GnssNoise()


def direct(planner, expected, **options):
    """The block adjusted with that control: sigmas (n, 3) of the check points, and the result."""
    adjusted = corridor.adjust(planner.block, control=list(expected.control), **options)
    names = list(adjusted.problem.point_names)
    rows = [names.index(name) for name in expected.check_points["point"]]
    # The block is perfect, sigma naught zero: covariances for unit weight are what was planned.
    return np.sqrt(adjusted.covariance.each_point[rows][:, [0, 2, 5]]), adjusted


def believed(expected):
    """Stated sigmas (n, 3) of the check points, of the adjustment alone."""
    survey = expected.network.block.sigma["control_m"] ** 2
    return np.sqrt(expected._stated.reshape(-1, 3) - survey)


class TestAgainstTheAdjustment:
    """3 % would do; algebra gives what loosely known points and rounding leave."""

    @pytest.mark.parametrize("control", [0, 1, 3, 7])
    def test_check_points_have_the_sigmas_of_a_direct_solution(self, small, control):
        expected = small.expect(control)
        sigma, _ = direct(small, expected)
        assert believed(expected) == pytest.approx(sigma, rel=1e-3)

    @pytest.mark.parametrize("control", [0, 1, 5])
    def test_parameters_have_the_sigmas_of_a_direct_solution(self, small, control):
        expected = small.expect(control)
        _, adjusted = direct(small, expected)
        assert [u.label for u in adjusted.problem.unknowns] == list(expected.parameters.parameter)
        assert expected.parameters["sigma"].to_numpy() == pytest.approx(
            np.sqrt(np.diag(adjusted.covariance.shared)), rel=1e-3
        )

    @pytest.mark.parametrize("control", [0, 1, 3])
    def test_correlations_are_those_of_the_adjustment(self, small, control):
        expected = small.expect(control)
        _, adjusted = direct(small, expected)
        pairs = adjusted.correlations.set_index(["a", "b"]).T
        for row in expected.correlations.itertuples():
            arm = pairs[f"lever_arm.{row.flight}.z", "height"]
            assert row.height_arm == pytest.approx(abs(arm["mean"]), abs=1e-3)
            assert row.height_arm_std == pytest.approx(arm["std"], abs=1e-3)
            both = pairs["camera.camlight.f", f"lever_arm.{row.flight}.z"]
            assert row.arm_f == pytest.approx(abs(both["mean"]), abs=1e-3)

    def test_bars_hold_the_scale_as_in_the_adjustment(self):
        ground, noise = Ground(bars=4), replace(SIGMAS, distance_m=0.0005)
        planner = Planner(plan_of(NADIR, OBLIQUE, ground=ground, noise=noise))
        expected = planner.expect(1)
        sigma, _ = direct(planner, expected)
        assert believed(expected) == pytest.approx(sigma, rel=1e-3)
        assert len(planner.block.distances) == 4
        assert not expected.parameters["parameter"].str.startswith("distance").any()
        loose = Planner(plan_of(NADIR, OBLIQUE, ground=ground)).expect(1)
        assert (believed(expected) < believed(loose)).all()

    def test_without_gnss_control_alone_holds_the_block(self):
        planner = Planner(plan_of(NADIR, OBLIQUE, gnss=False))
        expected = planner.expect(4)
        assert believed(expected) == pytest.approx(direct(planner, expected)[0], rel=0.01)

    def test_a_bias_with_a_prior_is_estimated_as_by_the_adjustment(self):
        priors = {f"gnss_bias.{axis}": 0.05 for axis in "xyz"}
        planner = Planner(plan_of(NADIR, OBLIQUE), effects=["gnss_bias"], priors=priors)
        expected = planner.expect(1)
        sigma, _ = direct(
            planner,
            expected,
            effects=["gnss_bias"],
            priors={name: (0.0, value) for name, value in priors.items()},
        )
        assert believed(expected) == pytest.approx(sigma, rel=1e-3)

    def test_a_camera_and_arms_that_are_held_are_held(self):
        planner = Planner(plan_of(NADIR), camera="fixed", lever_arm="fixed")
        expected = planner.expect(1)
        sigma, _ = direct(planner, expected, camera="fixed", lever_arm="fixed")
        assert believed(expected) == pytest.approx(sigma, rel=1e-3)
        assert not len(expected.parameters)
        assert expected.correlations["arm_f"].isna().all()

    def test_a_position_between_the_candidates_is_as_good_as_one_measured_with_them(self, small):
        """Its marks do not help the poses: with 50 other surveyed points nobody can tell."""
        where = small.candidates.set_index("point").loc["M7"]
        there = small.expect([(where.station, where.across + 0.01)])
        assert there.z == pytest.approx(small.expect(["M7"]).z, rel=0.03)
        assert there.control == (f"({where.station:g}, {where.across + 0.01:g})",)

    def test_a_new_position_changes_nothing_else(self, small):
        before = small.expect(3).d3
        small.expect([(33.3, 4.4)])
        assert small.expect(3).d3 == before


class TestTheNoiseOfTheGnss:
    def test_noise_as_stated_leaves_what_the_adjustment_states(self, small):
        for control in (0, 2):
            expected = small.expect(control)
            assert (expected.xy, expected.z) == pytest.approx(
                (expected.stated.xy, expected.stated.z), rel=1e-9
            )

    def test_twice_the_noise_everywhere_is_between_once_and_twice_the_error(self, small):
        known = Planner(small.plan, noise=GnssNoise(sigma_m=(0.0168, 0.011, 0.0192)))
        assert small.expect(0).z < known.expect(0).z < 2 * small.expect(0).z

    def test_no_noise_leaves_less_than_noise(self, small):
        known = Planner(small.plan, noise=GnssNoise(sigma_m=0.0))
        # What is left is the images' own.
        assert known.expect(0).z < 0.8 * small.expect(0).z

    def test_memory_for_ever_is_a_bias_of_each_flight(self, small):
        """With an endless correlation time an exposure's noise is the same in a whole flight."""
        sigma = (0.0084, 0.0055, 0.0096)
        memory = Planner(small.plan, noise=GnssNoise(correlated=1.0, correlation_s=1e9))
        bias = GnssNoise(sigma_m=0.0, bias_sigma_m=sigma, bias_per="flight")
        constant = Planner(small.plan, noise=bias)
        for control in (0, 1):
            a, b = memory.expect(control), constant.expect(control)
            assert (a.xy, a.z) == pytest.approx((b.xy, b.z), rel=1e-4)

    def test_memory_of_no_time_is_white(self, small):
        quick = Planner(small.plan, noise=GnssNoise(correlated=0.5, correlation_s=1e-3))
        assert quick.expect(1).d3 == pytest.approx(small.expect(1).d3, rel=1e-9)

    def test_a_bias_adds_its_square(self, small):
        """Without control all of it is on the ground: 3, 1, 7 cm are 3.16 cm in plan."""
        small.noise = GnssNoise(bias_m=(0.03, 0.01, 0.07))
        biased = small.expect(0)
        small.noise = QUIET
        white = small.expect(0)
        assert biased.z == pytest.approx(np.hypot(white.z, 0.07), rel=0.01)
        assert biased.xy == pytest.approx(np.hypot(white.xy, np.hypot(0.03, 0.01)), rel=0.01)

    def test_a_bias_of_unknown_size_counts_like_its_standard_deviation(self, small):
        small.noise = GnssNoise(bias_m=(0.0, 0.0, -0.05))
        known = small.expect(1).d3
        small.noise = GnssNoise(bias_sigma_m=(0.0, 0.0, 0.05))
        unknown = small.expect(1).d3
        small.noise = QUIET
        assert unknown == pytest.approx(known, rel=1e-9)

    def test_a_prior_of_the_bias_is_what_is_expected_of_it(self):
        """Said nothing else, the bias is drawn from its prior: truth and belief agree."""
        priors = {f"gnss_bias.{axis}": 0.05 for axis in "xyz"}
        planner = Planner(plan_of(NADIR, OBLIQUE), effects=["gnss_bias"], priors=priors)
        for control in (0, 1, 3):
            expected = planner.expect(control)
            assert (expected.xy, expected.z) == pytest.approx(
                (expected.stated.xy, expected.stated.z), rel=1e-6
            )

    def test_a_prior_of_each_flights_bias_is_what_is_expected_of_it(self):
        priors = {f"gnss_bias.{axis}": 0.05 for axis in "xyz"}
        planner = Planner(plan_of(NADIR, OBLIQUE), effects=["gnss_bias@flight"], priors=priors)
        assert len(planner.network.biases) == 6
        expected = planner.expect(1)
        assert expected.d3 == pytest.approx(expected.stated.d3, rel=1e-6)

    @pytest.mark.parametrize(
        ("wrong", "says"),
        [
            ({"correlated": 1.2}, "a share"),
            ({"correlation_s": 0.0}, "greater than 0"),
            ({"bias_per": "day"}, "block or flight"),
            ({"bias_m": (1.0, 2.0)}, "one number or three"),
            ({"sigma_m": -0.1}, "below 0"),
        ],
    )
    def test_noise_that_cannot_be_is_refused(self, wrong, says):
        with pytest.raises(InputError, match=says):
            GnssNoise(**wrong)


class TestADatumWithAHole:
    def test_without_gnss_and_control_everything_is_open(self):
        expected = Planner(plan_of(NADIR, gnss=False)).expect(0)
        assert np.isnan(expected.d3)
        assert expected.open.startswith("Position along x, position along y, height, rotation")
        assert "no control point and no GNSS" in expected.open

    def test_one_control_point_leaves_rotations_and_scale(self):
        said = Planner(plan_of(NADIR, gnss=False)).expect(1).open
        assert said.startswith("Rotation about x, rotation about y, rotation about z and scale of")

    def test_two_control_points_leave_the_turn_about_their_line(self):
        """The corridor runs along y."""
        said = Planner(plan_of(NADIR, gnss=False)).expect(["M1", "M13"]).open
        assert said.startswith("Rotation about y of the block")

    def test_one_calm_strip_with_free_arms_is_open_and_three_control_points_close_it(self):
        calm = replace(
            NADIR, strips=1, forward=0.8, images=None, position_jitter_m=0.0,
            attitude_jitter_deg=0.0,
        )  # fmt: skip
        planner = Planner(plan_of(calm))
        said = planner.expect(0).open
        assert "with free lever arms" in said and "otation about y" in said
        assert planner.expect(["L1", "R7", "L13"]).open == ""
        assert np.isnan(planner.expect(0).transfer).all()

    def test_what_is_open_can_be_printed_and_not_carried_over(self):
        expected = Planner(plan_of(NADIR, gnss=False)).expect(0)
        assert "stay open with" in repr(expected)
        with pytest.raises(InputError, match="nothing to carry over"):
            expected.carried()


@pytest.fixture(scope="module")
def calibration():
    return Planner(plan_of(replace(NADIR, name="other"), OBLIQUE, LOW_HIGH))


class TestAFlightSetCarriedOver:
    def test_a_prior_camera_is_worth_more_than_a_free_one_and_less_than_the_truth(
        self, nadir, calibration
    ):
        carried = calibration.expect(5).carried({"nadir": "other"})
        prior = Planner(nadir.plan, carried=carried).expect(0).z
        fixed = Planner(nadir.plan, camera="fixed", lever_arm="fixed").expect(0).z
        assert fixed < prior < 0.8 * nadir.expect(0).z

    def test_no_information_changes_nothing(self, nadir, calibration):
        carried = calibration.expect(5).carried({"nadir": "other"})
        vague = replace(carried, assumed=1e12 * carried.assumed, error=1e12 * carried.error)
        assert Planner(nadir.plan, carried=vague).expect(1).d3 == pytest.approx(
            nadir.expect(1).d3, rel=1e-4
        )

    def test_a_perfect_calibration_is_a_fixed_one(self, nadir, calibration):
        carried = calibration.expect(5).carried({"nadir": "other"}, held=True)
        perfect = replace(
            carried,
            assumed=1e-6 * carried.assumed,
            error=0.0 * carried.error,
            transfer=0.0 * carried.transfer,
        )
        fixed = Planner(nadir.plan, camera="fixed", lever_arm="fixed")
        for control in (0, 1):
            assert Planner(nadir.plan, carried=perfect).expect(control).d3 == pytest.approx(
                fixed.expect(control).d3, rel=1e-4
            )

    def test_held_errors_reach_the_ground(self, nadir, calibration):
        """A camera held wrong by its sigma, nothing else wrong: the error is linear in it."""
        carried = calibration.expect(5).carried({"nadir": "other"}, held=True)
        z = [
            Planner(nadir.plan, carried=replace(carried, error=k**2 * carried.error)).expect(0).z
            for k in (0, 1, 2)
        ]
        assert z[2] ** 2 - z[0] ** 2 == pytest.approx(4 * (z[1] ** 2 - z[0] ** 2), rel=1e-6)

    def test_the_same_bias_in_both_flights_cancels_in_height(self, nadir, calibration):
        """The arm has taken the bias, and gives it back."""
        carried = calibration.expect(9).carried({"nadir": "other"}, held=True)
        with_arm = Planner(nadir.plan, carried=carried).expect(0).transfer[2]
        camera_only = calibration.expect(9).carried(held=True)
        assert abs(with_arm) < 0.2
        assert Planner(nadir.plan, carried=camera_only).expect(0).transfer[2] > 0.8

    @pytest.mark.parametrize("arms", [{"nadir": "nobody"}, {"nobody": "other"}])
    def test_a_flight_that_is_not_there_is_refused(self, nadir, calibration, arms):
        with pytest.raises(InputError, match="carried over|no lever arm"):
            Planner(nadir.plan, carried=calibration.expect(5).carried(arms))

    def test_a_camera_that_is_held_cannot_be_carried_over_to(self, nadir, calibration):
        with pytest.raises(InputError, match="cannot be carried over"):
            Planner(nadir.plan, camera="fixed", carried=calibration.expect(5).carried())

    def test_held_values_have_no_sigma_and_their_error(self, nadir, calibration):
        """The error of a value that is held is what it came with."""
        source = calibration.expect(5)
        held = Planner(nadir.plan, carried=source.carried({"nadir": "other"}, held=True)).expect(1)
        ours = held.parameters.set_index("parameter")
        theirs = source.parameters.set_index("parameter")
        assert ours.loc["camera.camlight.f", "sigma"] == 0.0
        for name, other in (("camera.camlight.f",) * 2, ("lever_arm.nadir.z", "lever_arm.other.z")):
            assert ours.loc[name, "rms"] == pytest.approx(theirs.loc[other, "rms"], rel=1e-3)
        assert held.correlations[["arm_f", "height_arm", "height_f"]].isna().all(axis=None)

    def test_arms_of_flights_that_are_not_there_stay_behind(self, calibration):
        carried = calibration.expect(5).carried({"a": "other", "b": "oblique"})
        assert [x for x in carried.for_flights(["b"]).labels if "arm" in x] == [
            f"lever_arm.b.{axis}" for axis in "xyz"
        ]


class TestControlPoints:
    def test_points_are_spread_from_end_to_end(self, small):
        assert small.spread(0) == []
        assert small.spread(1) == ["M7"]
        assert small.spread(2) == ["L1", "R13"]
        assert small.spread(3) == ["L1", "R7", "L13"]
        assert len(set(small.spread(30))) == 30

    def test_more_control_is_never_worse_believed(self, small):
        sigma = [small.expect(small.spread(13)[:k]).stated.d3 for k in (0, 1, 2, 5, 13)]
        assert np.all(np.diff(sigma) < 0)

    def test_the_best_point_is_at_least_as_good_as_any(self, small):
        (best,) = small.best(1)
        error = {name: small.expect([name]).d3 for name in small.candidates["point"]}
        assert error[best] == min(error.values())

    def test_more_points_than_there_are_have_no_best_places(self, small):
        with pytest.raises(InputError, match="there are 39 candidates"):
            small.best(40)

    def test_a_check_point_that_controls_checks_no_more(self, small):
        expected = small.expect(["C2"])
        assert "C2" not in set(expected.check_points["point"])
        assert len(expected.check_points) == len(small.expect(0).check_points) - 1

    def test_a_flight_that_is_not_planned_over_a_point_does_not_measure_it(self):
        half = replace(NADIR, stations_m=(0.0, 60.0), images=18)
        grid = Surveyed.grid(plan_of(NADIR))
        planner = Planner(plan_of(half), surveyed=grid)
        assert "L13" in planner.network.unseen
        with pytest.raises(InputError, match="L13 is not seen in two images"):
            planner.expect(["L13"])

    @pytest.mark.parametrize(
        ("control", "says"),
        [
            (["nowhere"], "no point nowhere could be surveyed"),
            ([(5000.0, 0.0)], "seen in 0 images"),
            ([("a", "b")], "is not a point"),
            (-1, "-1 control points"),
            (1000, "there are 39 candidates"),
            (lambda p: list(p.check_points["point"]), "every check point is control"),
        ],
    )
    def test_control_that_cannot_be_is_refused(self, small, control, says):
        if callable(control):
            control = control(small.expect(0))
        with pytest.raises(InputError, match=says):
            small.expect(control)


def test_a_flight_that_shows_no_check_point_is_refused():
    far = Surveyed.grid(plan_of(NADIR))
    far = replace(far, station=far.station + 9000.0)
    with pytest.raises(InputError, match="shows no check point twice"):
        Planner(plan_of(NADIR), surveyed=far)


def test_effects_of_the_image_are_not_planned():
    with pytest.raises(InputError, match="those of the antenna"):
        Planner(plan_of(NADIR), effects=["rolling_shutter"])


def test_what_the_plan_says_of_control_is_left_aside():
    from corridor.core.simulation import Ground

    planner = Planner(plan_of(NADIR, ground=Ground(control=2, check=8)))
    assert planner.surveyed.check.sum() == 8
    assert len(planner.candidates) == 39


def test_a_control_point_is_moved_in_a_wink(small):
    """Half a second in a notebook, and 5 ms a set of known points: a slider follows the hand."""
    small.expect([(20.0, 3.0)])
    assert quickest(lambda: small.expect([(31.0, -3.0)])) < 0.5
    assert quickest(lambda: small.expect(3)) < 0.005


def test_a_model_says_the_same_as_its_options():
    """One type for `adjust`, `diagnose` and the planner; giving both is refused."""
    options = {"camera": "f,k1", "effects": ["gnss_bias"], "lever_arm": "fixed"}
    prior = {f"gnss_bias.{axis}": 0.05 for axis in "xyz"}
    told = Planner(plan_of(NADIR), **options, priors=prior).expect(2)
    model = Model(**options, priors={name: (0.0, sigma) for name, sigma in prior.items()})
    planner = Planner(plan_of(NADIR), model=model)
    assert planner.expect(2).parameters.equals(told.parameters)
    with pytest.raises(InputError):
        Planner(plan_of(NADIR), model=model, camera="fixed")


def test_a_level_of_detection_is_that_of_the_model_that_is_given(nadir, monkeypatch):
    """It was that of the default model, and of free arms, whatever the model said."""
    asked = []
    monkeypatch.setattr(
        "corridor.change.detection", lambda block, model, **options: asked.append(model)
    )
    model = Model(camera="fixed", effects=["gnss_bias"], lever_arm="fixed")
    for options in ({"model": model}, {"camera": "fixed"}):
        detectable(nadir.plan, nadir.block, Believed(**options))
    assert asked[0] == model
    assert (asked[1].camera, asked[1].lever_arm) == ("fixed", "free")
