"""Nothing is named that does not happen, or that takes check points away from their places."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import corridor
from benchmarks.diagnosis.real_noise import inject, scene_of, surveys
from corridor.core.effects import find
from corridor.diagnosis.evidence.evidence import Evidence, gain_of
from corridor.diagnosis.evidence.plausibility import impossible, plausible
from corridor.diagnosis.evidence.search import Found, contributions
from corridor.diagnosis.findings.findings import Estimate, Findings, Unknown
from corridor.diagnosis.system.elimination import Reduced
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification import verification
from corridor.diagnosis.verification.held_out import harms
from corridor.diagnosis.verification.verification import Verification


def one_group(slug, M, g, point=None):
    """Evidence of one group of an effect's parameters, with M and g in prior sigmas."""
    effect = find(slug)
    parameters = effect.parameters(None)
    group = Group(
        slug if point is None else f"{slug}.{point}",
        effect,
        None,
        np.arange(len(parameters)),
        np.array([p.scale for p in parameters]),
        [("block", p.name, p.unit) for p in parameters],
        single=point,
        most=np.array([p.most for p in parameters]),
    )
    reduced = Reduced(M, g, [group])
    return Evidence(reduced), group


class TestASizeThatDoesNotHappen:
    @pytest.mark.parametrize("fraction, ruled_out", [(1.0, False), (3.0, False), (90.0, True)])
    def test_ninety_earths_are_no_curvature(self, fraction, ruled_out):
        """M of a sigma of 0.1 of the prior's; a Gauss-Newton step leads to `fraction`."""
        M = np.array([[100.0]])
        evidence, group = one_group("earth_curvature", M, M @ [fraction])
        found = impossible(evidence, Found({0: 100.0}, {0: 50.0}, 50.0))
        assert bool(found) is ruled_out
        if ruled_out:
            assert "more than 4 does not happen" in found[group.key]

    def test_what_is_not_known_to_two_sigmas_is_not_ruled_out(self):
        M = np.array([[1e-4]])
        evidence, _ = one_group("earth_curvature", M, M @ [90.0])
        assert not impossible(evidence, Found({0: 1000.0}, {0: 5.0}, 5.0))

    def test_what_is_known_well_is_not_given_up_for_what_is_not(self):
        """A lever arm of 0.3 m in x; in z, which a focal length can imitate, 2 m with 0.4 m."""
        scale = find("lever_arm").parameters(None)[0].scale
        M = np.diag(scale**2 / np.array([0.01, 0.01, 0.4]) ** 2)
        evidence, _ = one_group("lever_arm", M, M @ (np.array([0.3, 0.0, 2.0]) / scale))
        assert not impossible(evidence, Found({0: 10.0}, {0: 400.0}, 400.0))
        evidence, group = one_group("lever_arm", M, M @ (np.array([0.01, 0.0, 2.0]) / scale))
        told = impossible(evidence, Found({0: 10.0}, {0: 12.0}, 12.0))
        assert "with z 2 m" in told[group.key]

    def test_a_group_that_is_ruled_out_is_never_offered_again(self):
        M = np.array([[100.0]])
        evidence, group = one_group("earth_curvature", M, M @ [90.0])
        assert evidence.given({})[0].evidence > 100
        evidence.barred.add(group.key)
        assert evidence.given({})[0].evidence == -np.inf


class TestAnErrorInTheHeightOfOnePoint:
    def test_is_not_hidden_by_plan_coordinates_that_are_right(self):
        """An error of five sigmas in z: chi square 25, three parameters against one."""
        M = np.diag([4.0, 4.0, 4.0])
        evidence, group = one_group("control_blunder", M, np.array([0.0, 0.0, 10.0]), "P1")
        whole = gain_of(group, M, np.array([0.0, 0.0, 10.0]))
        assert evidence.given({})[0].evidence > whole.evidence

    def test_costs_at_most_the_choice_among_three(self):
        """Where nothing is wrong, looking at parts brings no more than a third of it each."""
        M = np.diag([4.0, 4.0, 4.0])
        evidence, group = one_group("control_blunder", M, np.zeros(3), "P1")
        assert evidence.given({})[0].evidence < 0.0


class TestPartsOfAShape:
    """A shape of one kind of measurements, and an effect that shows in the same kind."""

    @staticmethod
    def left(across):
        """Keys that stay of a shape and an effect that brings less than half as much beside it."""
        groups = []
        for n, slug in enumerate(("image_deformation", "thermal")):
            effect = find(slug)
            labels = [("block", "p", "px")]
            groups.append(Group(slug, effect, None, np.array([n]), np.ones(1), labels))
        M = np.array([[100.0, across], [across, 100.0]])
        found = np.linalg.solve(M, [0.0, 0.0]) + np.array([1.6, 1.0])
        reduced = Reduced(M, M @ found, groups)
        evidence = Evidence(reduced)
        chosen = {0: 1.0, 1: 1.0}
        each = contributions(evidence, chosen)
        assert each[1] < 0.5 * each[0]
        left = plausible(evidence, Found(chosen, each, 0.0), 2.5)
        return {evidence.groups[n].key for n in left.chosen}

    def test_what_brings_as_much_without_the_shape_has_nothing_to_do_with_it(self):
        assert self.left(0.0) == {"image_deformation", "thermal"}

    def test_what_brings_more_without_the_shape_is_a_part_of_it(self):
        assert self.left(60.0) == {"image_deformation"}


def checked(differences, sigma=0.01):
    """An adjustment of which these are the check points, m."""
    d = np.asarray(differences, dtype=float)
    names = [f"P{k}" for k in range(len(d))]
    table = pd.DataFrame({"point": names})
    table[["dx", "dy", "dz"]] = d
    table[["s_dx", "s_dy", "s_dz"]] = sigma
    block = SimpleNamespace(
        ground=pd.DataFrame({"point": names}),
        ground_sigma=lambda: np.full((len(d), 3), sigma),
    )
    rms = SimpleNamespace(d3=float(np.sqrt((d**2).sum(axis=1).mean())))
    return SimpleNamespace(check_points=table, check_rms=rms, system=SimpleNamespace(block=block))


class TestCheckPointsHaveTheLastWord:
    def test_half_a_metre_away_from_them_is_harm(self):
        """As the real survey of 376 images had it: 86 mm before, 502 mm after."""
        before = checked([[0.02, 0.01, 0.08], [-0.01, 0.02, 0.09]])
        after = checked([[0.02, 0.01, -0.49], [-0.01, 0.02, -0.51]])
        assert harms(before, after)
        assert not harms(after, before)

    def test_a_millimetre_within_their_noise_is_none(self):
        before = checked([[0.002, 0.001, 0.008], [-0.001, 0.002, 0.009]])
        after = checked([[0.002, 0.001, 0.009], [-0.001, 0.002, 0.010]])
        assert not harms(before, after)

    def test_without_any_nothing_is_said(self):
        none = checked(np.zeros((1, 3)))
        none.check_points = none.check_points[:0]
        assert not harms(none, none)

    def test_a_true_effect_is_harm_in_one_of_twenty_at_most(self):
        """Differences that the effect brings to zero but for noise of the stated size."""
        rng = np.random.default_rng(5)
        lost = 0
        for _ in range(400):
            noise = rng.normal(size=(4, 3)) * 0.01 * np.sqrt(2)
            moved = rng.normal(size=3) * 0.02 + np.zeros((4, 3))
            lost += harms(checked(noise - moved), checked(noise))
        assert lost <= 0.05 * 400 + 3 * np.sqrt(0.05 * 0.95 * 400)

    @pytest.mark.parametrize(
        ("place", "point", "weakest"),
        [("image", "G1", "control_blunder.G1"), ("ground", "G1", None), ("image", None, None)],
    )
    def test_no_point_is_called_wrong_by_bent_pictures_that_check_points_contradict(
        self, place, point, weakest, monkeypatch
    ):
        """Rows that wander by 1.5 px made two good control points contradict the rest."""
        asked = object.__new__(Verification)
        key = "control_blunder.G1" if point else "gnss_bias"
        bending = SimpleNamespace(key="row_polynomial", single=None)
        bending.effect = SimpleNamespace(place=place)
        asked._groups = [bending, SimpleNamespace(key=key, single=point)]
        asked.findings = Findings(
            [Estimate(key, "named", 9.0, [], key=key)],
            [Unknown("row_polynomial", "unknown", 9.0, number=0)],
        )
        asked.used, asked._now = [key], checked([[0.004, 0.0, 0.009]])
        asked._without = lambda _: ([], checked([[0.004, 0.0, 0.008]]))
        asked._held = None
        monkeypatch.setattr(verification, "worse", lambda *_: False)
        assert (asked._harmful() or [None])[0] == weakest


class TestKnownEffectsInMeasuredBlocks:
    """The bench of real noise, held to the package's own estimates.

    A real rolling shutter beside a real lens is what chapter 5 ends with: its outputs are compared.
    """

    @pytest.fixture
    def dike(self):
        block = corridor.read("data_synthetic/dike")
        return block, scene_of(corridor.adjust(block))

    @pytest.mark.parametrize(
        "slug, parameter, size, close",
        [
            ("rolling_shutter", "readout", 0.030, 2e-4),
            ("gnss_drift", None, 2e-4, 1e-6),
            ("clock_offset", "offset", 0.020, 2e-4),
            ("focal_drift", "rate", 0.01, 2e-4),
            ("principal_point_drift", None, 0.01, 2e-4),
            ("lever_arm", None, 0.1, 2e-3),
        ],
    )
    def test_what_is_put_in_is_what_an_adjustment_finds_more(
        self, dike, slug, parameter, size, close
    ):
        """The noise is the same with and without, so the estimates differ by what was put in."""
        block, scene = dike
        made, truth = inject(block, scene, {slug: size}, seed=3)
        velocity = dict(zip(("vx", "vy", "vz"), scene.velocity.T, strict=True))
        told = {p["name"]: p["value"] for p in truth["effects"][0]["parameters"]}
        tables = []
        for one in (made, block):
            one = one.copy()
            # The bench knows of speeds only: real projects have no angular rates.
            one.images = one.images.drop(columns=["wx", "wy", "wz"]).assign(**velocity)
            found = corridor.adjust(one, effects=[slug], lever_arm="fixed")
            tables.append(found.effects.set_index("parameter"))
        gained = tables[0]["value"] - tables[1]["value"]
        for name in [parameter] if parameter else told:
            assert gained[name] == pytest.approx(told[name], abs=close)

    @pytest.mark.slow
    def test_an_untouched_survey_is_left_alone(self, real_data):
        """Its lens is 0.1 px off Fraser's, as lenses are; nothing else is there to be named."""
        found = corridor.diagnose(surveys()["pair"]())
        assert found.verdict == "nothing"
        assert 0.05 < found.lens["rms_px"] < 0.3 and not found.lens["costs"]

    @pytest.mark.slow
    def test_two_blunders_that_hide_each_other_are_named(self, real_data):
        """Six stated sigmas each, in two of three control points: check points tell which two.

        Over twenty seconds: the smallest real block whose check points can tell has 206 images.
        """
        block = surveys()["flight2"]()
        made, truth = inject(block, scene_of(corridor.adjust(block)), {"two_blunders": 0.3}, seed=3)
        found = corridor.diagnose(made)
        named = {one["point"] for one in found.effects if one["class"] == "named"}
        assert named == {one["point"] for one in truth["effects"]}
        assert found.gap["check_m"]["after"] < 0.5 * found.gap["check_m"]["before"]
