"""Evidence, threshold, robust residuals and noise, each against an answer known otherwise."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.sparse import csc_array, csr_array

from benchmarks.diagnosis.signal import _from_noise
from corridor.core.adjustment import ImageRows
from corridor.diagnosis.evidence.evidence import Evidence, Spectrum, averaged, effect_sizes
from corridor.diagnosis.evidence.profile_likelihood import NoiseModel, _probability
from corridor.diagnosis.evidence.search import largest_of_null, search
from corridor.diagnosis.noise.gnss import stated_noise
from corridor.diagnosis.noise.image import pseudo_residuals, scale_of
from corridor.diagnosis.noise.likelihood import Arguments, estimate
from corridor.diagnosis.system.elimination import Elimination, Reduced
from corridor.diagnosis.system.equations import Columns, Equations, moved_by
from corridor.diagnosis.system.groups import Group


def system(columns, g, sizes):
    """A reduced system of groups of these sizes; columns (n, p): M = columns' columns."""
    M = columns.T @ columns
    groups, at = [], 0
    for n, size in enumerate(sizes):
        effect = SimpleNamespace(slug=f"e{n}", generic=False, place="image", group="block")
        labels = [("block", f"p{k}", "px") for k in range(size)]
        groups.append(Group(f"e{n}", effect, None, np.arange(at, at + size), np.ones(size), labels))
        at += size
    return Evidence(Reduced(M, g, groups))


def drift_and_shape(wiggle):
    """A drift of a hundred epochs with slow noise, and two that explain it: it, and nine curves.

    wiggle: size of a fourth-degree curve that is there too, in standard deviations.
    """
    t = np.linspace(-1.0, 1.0, 100)
    curves = np.polynomial.legendre.legvander(t, 9)[:, 1:]
    rng = np.random.default_rng(3)
    slow = np.convolve(rng.normal(size=119), np.ones(20), "valid") / 20**0.5
    y = 3.0 * t + slow + wiggle * curves[:, 3]
    B = np.column_stack([t, curves])
    evidence = system(B, B.T @ y, [1, 9])
    evidence.groups[1].effect.generic = True
    return evidence


def test_an_effect_takes_the_place_of_a_shape_that_follows_slow_noise_too():
    """White noise is what evidence knows of: of slow noise nine curves explain more than chance."""
    evidence = drift_and_shape(0.0)
    drift, shape = evidence.given({})
    assert 0.85 * shape.evidence < drift.evidence < shape.evidence
    assert set(search(evidence, 4.0).chosen) == {0}


def test_a_shape_stays_where_the_effect_explains_the_half_of_it():
    assert 1 in search(drift_and_shape(4.0), 4.0).chosen


def test_what_was_asked_in_part_is_asked_as_a_whole_again():
    """A spectrum of one parameter was kept for a group that had three again, and met its size."""
    rng = np.random.default_rng(4)
    B = rng.normal(size=(50, 3))
    evidence = system(B, B.T @ B[:, 0], [3])
    whole = evidence.given({})[0]
    evidence.narrow(0, ["p0"])
    assert evidence.given({})[0].evidence != whole.evidence
    evidence.widen()
    assert evidence.given({})[0].evidence == whole.evidence


def test_the_log_bayes_factor_is_the_integral_over_the_prior():
    """One parameter: log of the integral of N(theta; 0, kappa^2) exp(g theta - M theta^2 / 2)."""
    M, g = 7.0, 9.0
    found = Spectrum.of(np.array([[M]])).log_bayes(np.array([g]))
    for kappa, value in zip(effect_sizes()[0][:5], found, strict=False):
        integral, _ = quad(
            lambda x, k=kappa: np.exp(g * x - 0.5 * M * x * x - 0.5 * (x / k) ** 2)
            / (k * np.sqrt(2 * np.pi)),
            -8, 8, points=[g / M], epsabs=0, epsrel=1e-10, limit=400,
        )  # fmt: skip
        assert value == pytest.approx(np.log(integral), abs=1e-6)


def test_what_nothing_determines_says_nothing_whatever_its_size():
    """A scale of all positions in a free block: a thousand times what happens "explained" much."""
    M = np.diag([7.0, 2e-5])
    both = Spectrum.of(M)
    h = both.vector.T @ np.array([9.0, 0.05])
    alone = Spectrum.of(M[:1, :1]).log_bayes(np.array([9.0]))
    assert both.log_bayes(h) == pytest.approx(alone, abs=1e-12)


def test_the_weights_of_the_prior_scales_add_up_to_one():
    assert np.exp(effect_sizes()[1]).sum() == pytest.approx(1.0, abs=1e-3)
    assert averaged(np.zeros(len(effect_sizes()[0]))) == pytest.approx(0.0, abs=1e-3)


def test_evidence_given_others_is_that_of_residuals_freed_of_them():
    """Conditioning on a group of wide prior is projecting its columns out."""
    rng = np.random.default_rng(1)
    B = rng.normal(size=(200, 5))
    y = rng.normal(size=200) + 3 * B[:, 0]
    evidence = system(B, B.T @ y, [2, 3])
    given = evidence.given({0: 1000.0})[1]
    A = B[:, :2]
    Q = np.eye(200) - A @ np.linalg.solve(A.T @ A, A.T)
    alone = system(Q @ B[:, 2:], B[:, 2:].T @ Q @ y, [3]).given({})[0]
    assert given.evidence == pytest.approx(alone.evidence, abs=1e-3)


def test_the_search_finds_both_of_two_correlated_effects_and_no_third():
    rng = np.random.default_rng(2)
    B = rng.normal(size=(400, 6))
    B[:, 1] += B[:, 0]
    y = rng.normal(size=400) + 0.6 * B[:, 0] - 0.6 * B[:, 3]
    found = search(system(B, B.T @ y, [1] * 6), 4.0)
    assert set(found.chosen) == {0, 3}


def test_a_merged_explanation_is_preferred_to_two_that_imitate_it():
    rng = np.random.default_rng(3)
    B = rng.normal(size=(400, 2))
    B = np.column_stack([B, B.sum(axis=1)])
    y = rng.normal(size=400) + 2.0 * B[:, 2]
    assert set(search(system(B, B.T @ y, [1, 1, 1]), 4.0).chosen) == {2}


def test_the_threshold_is_exceeded_by_chance_as_often_as_it_says():
    """Correlated candidates, 400 null blocks: 5 % beyond the 95 % quantile, +- 3.3 % (3 sigma)."""
    rng = np.random.default_rng(4)
    B = rng.normal(size=(60, 8))
    B[:, 4:] += 2.0 * B[:, :4]
    evidence = system(B, np.zeros(8), [1, 1, 1, 1, 4])
    limit = np.quantile(largest_of_null(evidence, 4000, rng), 0.95)
    beyond = 0
    for _ in range(400):
        g = B.T @ rng.normal(size=60)
        largest = max(gain.evidence for gain in system(B, g, [1, 1, 1, 1, 4]).given({}))
        beyond += largest > limit
    assert beyond / 400 == pytest.approx(0.05, abs=0.033)


def test_the_scale_of_student_t_residuals_is_found_in_spite_of_wrong_matches():
    """20,000 residuals of scale 0.3, 5 % of them wrong by up to 30 px: within 10 %."""
    rng = np.random.default_rng(5)
    r = 0.3 * rng.standard_normal((20_000, 2)) * np.sqrt(4 / rng.chisquare(4, 20_000))[:, None]
    r[:1000] += rng.uniform(-30, 30, (1000, 2))
    assert scale_of((r**2).sum(axis=1)) == pytest.approx(0.3, rel=0.15)


def test_coloured_noise_is_told_from_white():
    """300 epochs, 1 s apart, 5 mm white and 15 mm with 30 s memory: both within a third."""
    rng = np.random.default_rng(6)
    n = 300
    keep = np.exp(-1 / 30)
    slow = np.empty((n, 3))
    slow[0] = rng.normal(size=3)
    for k in range(1, n):
        slow[k] = keep * slow[k - 1] + np.sqrt(1 - keep**2) * rng.normal(size=3)
    y = 0.005 * rng.normal(size=(n, 3)) + 0.015 * slow
    e = known_otherwise(np.arange(n, dtype=float), y, 0.01)
    noise = estimate(e, (), Arguments(stated_noise(e.system))).noise
    assert 0.01 * np.mean(noise.white) == pytest.approx(0.005, rel=0.33)
    assert np.mean(noise.coloured) == pytest.approx(0.015, rel=0.33)


def known_otherwise(time, y, stated):
    """Equations of a flight whose poses are known otherwise: y (n, 3) is the noise, or a bias."""
    count = len(time)
    images = SimpleNamespace(flight=np.zeros(count, int), flight_names=["1"], time=time)
    gnss = SimpleNamespace(
        image=np.arange(count), sigma=np.tile(stated, (count, 1)) * np.ones(3), residual=y
    )
    narrow = SimpleNamespace(image_count=count, exposure_count=count, bandwidth=1)
    labels = [("block", axis, "m") for axis in "xyz"]
    effect = SimpleNamespace(slug="e0", generic=False, place="antenna", group="block")
    group = Group("e0", effect, None, np.arange(3), np.ones(3), labels)
    core = Columns(
        np.zeros((0, 3)), np.zeros((3, 3)), np.zeros(3), np.tile(np.eye(3), (count, 1)), np.zeros(3)
    )
    return Equations(
        SimpleNamespace(images=images, gnss=gnss, problem=narrow), csc_array((0, 0)), np.zeros(0),
        csr_array((3 * count, 0)), core, [], [], {}, [group], np.zeros(0, int), np.zeros(0, int),
        np.arange(3), [], np.ones(3),
    )  # fmt: skip


def biased(rng, epochs=40, step=2.5, tau=60.0, bias=0.05):
    """A flight of 100 s with poses known otherwise, and a bias of 0.05 m: its noise model.

    White noise of 5 mm and slow noise of 12 mm, stated as 13 mm in all.
    """
    time = step * np.arange(epochs)
    lag = np.abs(time[:, None] - time)
    half = np.linalg.cholesky(0.005**2 * np.eye(epochs) + 0.012**2 * np.exp(-lag / tau))
    e = known_otherwise(time, bias + half @ rng.standard_normal((epochs, 3)), 0.013)
    return NoiseModel(Evidence(Elimination(e, None).reduced()))


@pytest.mark.slow
def test_the_sigma_of_a_bias_covers_what_slow_noise_makes_of_it():
    """36 flights, 3 axes: error over sigma spreads as wide as it says, 0.8 to 1.3.

    A constant is known from the few correlation times that a flight lasts. White noise as stated
    would make it 2 mm, and errors are 9 mm.
    """
    rng = np.random.default_rng(9)
    pulls = []
    for _ in range(36):
        noises = biased(rng)
        noise, _ = noises.given({0: 1000.0})
        theta, covariance = noises.parameters({0: 1000.0}, noise, rng)
        pulls.append((theta[0] - 0.05) / np.sqrt(np.diag(covariance[0])))
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.3


def odds_of_a_bias(bias, flights, rng):
    """Log odds (flights,) of a bias beside noise that may be slow, in flights that have it."""
    out = []
    for _ in range(flights):
        noises = biased(rng, bias=bias)
        _, without = noises.given({})
        out.append(_probability(noises, {}, 0, 1.0)[0] - without)
    return np.array(out)


def test_slow_noise_is_taken_for_a_bias_as_rarely_as_the_odds_say():
    """Markov: odds beyond e^3 in at most e^-3 = 5 % of flights without it, 2 of 50 and one more.

    White noise as stated would swear to a bias in most of them: its mean is known to 2 mm then,
    and slow noise moves it by 9 mm.
    """
    rng = np.random.default_rng(12)
    assert np.sum(odds_of_a_bias(0.0, 50, rng) > 3.0) <= 3


@pytest.mark.slow
def test_a_group_is_told_from_noise_by_as_much_as_it_says():
    """Foretold from flights that lack it: the gain in log likelihood of those that have it.

    Mean of 30 flights with the true bias and the noise that fits best, less that without: within a
    fifth. With the noise known it would be more than twice that.
    """
    rng = np.random.default_rng(13)
    theta = np.full(3, 0.05)
    foretold = [_from_noise(biased(rng, bias=0.0), 0, theta) for _ in range(30)]
    found = []
    for _ in range(30):
        noises = biased(rng)
        e, group = noises.equations, noises.evidence.groups[0]
        alone, with_it = (
            estimate(one, (), noises.arguments).value for one in (e, moved_by(e, group, -theta))
        )
        found.append(0.5 * (alone - with_it))
    assert np.mean(foretold) == pytest.approx(np.mean(found), rel=0.2)
    lag = 2.5 * np.abs(np.arange(40)[:, None] - np.arange(40))
    true = 0.005**2 * np.eye(40) + 0.012**2 * np.exp(-lag / 60.0)
    known = 0.5 * 3 * 0.05**2 * np.linalg.inv(true).sum()
    assert np.mean(foretold) < 0.5 * known


@pytest.mark.parametrize("rays", [4, 8])
def test_the_size_of_the_noise_is_found_in_spite_of_few_rays(rays):
    """4,000 normal observations of sigma 1 whose points take up 3 of 8, or of 16: within 6 %."""
    rng = np.random.default_rng(8)
    points = 4000 // rays
    residual = np.zeros((points, rays, 2))
    systems = []
    for _ in range(points):
        base = rng.uniform(-0.5, 0.5, (rays, 2))
        A = np.concatenate([np.column_stack([np.eye(2), b]) for b in base])
        systems.append((A, rng.standard_normal(2 * rays)))
    # Student's t with the scale of its own residuals.
    scale = 1.0
    for _ in range(4):
        for n, (A, error) in enumerate(systems):
            x = np.zeros(3)
            for _ in range(8):
                left = (error - A @ x).reshape(rays, 2)
                weight = np.repeat(6.0 / (4.0 + (left**2).sum(axis=1) / scale**2), 2)
                heavy = A * weight[:, None]
                x = np.linalg.solve(heavy.T @ A, heavy.T @ error)
            residual[n] = (error - A @ x).reshape(rays, 2)
        scale = scale_of((residual**2).sum(axis=2).ravel())
    n = points * rays
    point, nothing = np.arange(n) // rays, np.zeros(n, int)
    rows = ImageRows(nothing, point, np.ones(n, bool), nothing, np.zeros((n, 2)), np.ones(n))
    system = SimpleNamespace(
        image_rows=rows,
        state=SimpleNamespace(points=np.zeros((points, 3))),
        columns=SimpleNamespace(shared=[], pose=np.zeros((0, 6))),
    )
    _, scales = pseudo_residuals(system, residual.reshape(n, 2))
    assert scales.tie == pytest.approx(1.0, rel=0.06)


def test_draws_have_the_covariance_and_rounding_turns_none():
    """Of a plane of equal values any two vectors are eigenvectors; draws are the same in all."""
    rng = np.random.default_rng(3)
    M = np.diag([4.0, 4.0, 1.0, 0.0])
    drawn = Spectrum.of(M).drawn(20_000, np.random.default_rng(5))
    assert np.cov(drawn) == pytest.approx(M, abs=0.12)
    for _ in range(5):
        rounded = M + 1e-14 * rng.standard_normal(M.shape)
        again = Spectrum.of(rounded).drawn(20_000, np.random.default_rng(5))
        assert np.abs(again - drawn).max() < 1e-5
