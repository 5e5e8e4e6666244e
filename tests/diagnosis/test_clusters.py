"""Scores by clusters: what they add up to, and what residuals that hang together make of them."""

from dataclasses import replace

import numpy as np
import pytest
from strips import CAMLIGHT, corridor_block

from corridor.core.adjustment import Model
from corridor.core.effects import candidates
from corridor.core.simulation import add_noise
from corridor.diagnosis.evidence.evidence import Evidence, gain_of
from corridor.diagnosis.evidence.scores import Influence, as_spread, drawn, inflation_of_scores
from corridor.diagnosis.evidence.search import Found
from corridor.diagnosis.findings.strips import of_group
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.system.elimination import Elimination
from corridor.diagnosis.system.equations import equations

SLUGS = ["rolling_shutter", "lever_arm", "gnss_drift", "principal_point_drift", "refraction"]


def asked(block):
    """Adjustment, elimination with the stated GNSS noise, its candidates, and their evidence."""
    believed = ReferenceModel.of(block, Model(camera="fixed"))
    adjustment = believed.adjust()
    chosen = candidates(block, adjustment.system.free, [], adjustment.system.control_names, SLUGS)
    elimination = Elimination(equations(adjustment, chosen.effects, {}), None)
    reduced = elimination.reduced()
    return adjustment, elimination, reduced, Evidence(reduced)


def made(images=40, **noise):
    camera = replace(CAMLIGHT, calibrated=True)
    block = corridor_block(
        images=images, strips=4, camera=camera, observations_per_image=80, control=0, check=0,
        relief=5.0, seed=3,
    )  # fmt: skip
    block.lever_arm_fixed = True
    return add_noise(block, **({"tie_px": 0.3, "gnss_m": 0.02, "seed": 4} | noise))


@pytest.fixture(scope="module")
def quiet():
    return asked(made())[1:]


@pytest.mark.parametrize("slug", SLUGS)
def test_information_by_images_adds_up_to_that_of_the_reduced_equations(quiet, slug):
    """Without control all of it lies in the pictures and at the antenna."""
    elimination, reduced, evidence = quiet
    group = evidence.groups[evidence.number[slug]]
    core = np.zeros((len(reduced.g), len(group)))
    step = 100.0  # metres and degrees: what is moved is as linear as it is nearby
    core[group.columns] = step * np.eye(len(group))
    images = np.arange(len(elimination.equations.system.images.names))
    score, inside = Influence(elimination).by_cluster(core, images)
    M, g = evidence.block(group)
    inside, score = inside / step**2, score / step
    assert np.abs(inside.sum(axis=0) - M).max() < 1e-3 * np.abs(M).max()
    # A score is that of the residuals at the state, its value put back: here zero.
    assert np.abs(score.sum(axis=0) - g).max() < 1e-2 * np.sqrt(np.diag(M)).max()


def test_independent_residuals_are_worth_what_they_are():
    adjustment, elimination, reduced, evidence = asked(made())
    draws = drawn(adjustment, elimination.equations)
    # Redundancy: an observation keeps that share of its variance on the average.
    rows = elimination.equations.system.image_rows
    unknown = 3 * (rows.point.max() + 1) + 6 * (rows.image.max() + 1)
    kept = 1.0 - unknown / (2 * len(rows.point))
    assert np.mean([np.mean(draw**2) for draw in draws]) == pytest.approx(kept, abs=0.03)
    influence = Influence(elimination, draws)
    asked_of = [evidence.number[slug] for slug in SLUGS[:4]]
    phi = inflation_of_scores(influence, evidence, asked_of)
    assert (phi >= 1.0).all() and phi[asked_of].mean() < 1.3


def test_residuals_that_images_share_inflate_the_scores(quiet):
    """Ten images in a row see all points shifted along by one draw: their scores agree."""
    block = made()
    _, elimination, reduced, evidence = asked(block)
    influence = Influence(elimination)
    n = evidence.number["rolling_shutter"]
    before = inflation_of_scores(influence, evidence, [n])
    core = np.zeros((len(reduced.g), 1))
    core[evidence.groups[n].columns] = 1.0
    (moved,) = influence.moves(core)
    rows = elimination.equations.system.image_rows
    order = elimination.equations.system.image_order
    run = order[rows.image] // 10
    amount = np.array([3.0, -3.0, 3.0, -3.0])[run]
    share = np.sqrt(np.sum(moved**2 * influence.weight[:, None]))
    influence.residual += amount[:, None] * moved / share
    after = inflation_of_scores(influence, evidence, [n])
    # Four clusters of 9 / 4 each: 4 / 3 of 4 * (9 / 16) at least, of which ten others know nothing.
    assert after[n] > before[n] + 0.5


class TestWhatAFactorMakesOfEvidence:
    @pytest.fixture
    def spread(self, quiet):
        _, reduced, plain = quiet
        factor = np.ones(len(plain.groups))
        factor[plain.number["lever_arm"]] = 4.0
        return plain, Evidence(reduced, inflation=factor)

    def test_it_divides_what_is_known(self, spread):
        plain, counted = spread
        n = plain.number["lever_arm"]
        M, g = plain.block(plain.groups[n])
        expected = gain_of(plain.groups[n], M / 4.0, g / 4.0).evidence
        here, there = plain.given({}), counted.given({}, spread=True)
        assert there[n].evidence == pytest.approx(expected)
        others = [k for k in range(len(here)) if k != n]
        assert [here[k].evidence for k in others] == [there[k].evidence for k in others]
        _, covariance = plain.solution({n: 1.0})
        assert np.allclose(counted.honest(n, covariance[n]), 4.0 * covariance[n])

    def test_what_competes_is_compared_without(self, spread):
        plain, counted = spread
        assert [g.evidence for g in counted.given({})] == [g.evidence for g in plain.given({})]

    def test_a_model_loses_what_its_spread_does_not_bear(self, spread):
        _, counted = spread
        n, other = (counted.number[slug] for slug in ("lever_arm", "rolling_shutter"))
        found = Found({n: 1.0, other: 1.0}, {n: 8.0, other: 5.0}, 13.0)
        assert set(as_spread(counted, found, 2.5).chosen) == {other}


class TestStripsLeftOut:
    """Four strips of equal information; what each says of a readout, in sigmas of all together."""

    @staticmethod
    def told(quiet, says):
        elimination, reduced, evidence = quiet
        n = evidence.number["rolling_shutter"]
        core = np.zeros((len(reduced.g), 1))
        core[evidence.groups[n].columns] = 1.0
        influence = Influence(elimination)
        strip = np.argsort(np.argsort(elimination.equations.system.image_order)) // 10
        (moved,) = influence.moves(core)
        antenna = influence.antenna_moved(core)
        sigma = 1.0 / np.sqrt(evidence.block(evidence.groups[n])[0][0, 0])
        amount = sigma * np.array(says)[strip]
        influence.residual = amount[elimination.equations.system.image_rows.image][:, None] * moved
        influence.antenna = np.repeat(amount[elimination.equations.image], 3) * antenna[:, 0]
        score, _ = influence.by_cluster(core, strip)
        told = replace(reduced, g=reduced.g.copy())
        told.g[evidence.groups[n].columns] = score.sum()
        return of_group(Evidence(told), influence, strip, n, [n]), sigma

    def test_what_all_say_is_proved_with_the_sigma_of_their_spread(self, quiet):
        one, sigma = self.told(quiet, [11.0, 9.0, 11.0, 9.0])
        assert one.count == 4 and one.proved and (one.gain > 0).all()
        # Spread of 1 about the mean of four: sigma / sqrt(3); strips are not quite of one size.
        assert one.sigma[0] == pytest.approx(sigma / np.sqrt(3), rel=0.4)

    def test_what_half_of_them_contradict_is_not(self, quiet):
        one, sigma = self.told(quiet, [20.0, -4.0, 20.0, -4.0])
        assert not one.proved
        assert one.sigma[0] > 5 * sigma
