"""Both engines find the same numbers: each a form of the mathematics that knows nothing of the
other's."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rigged import rigged_block
from strips import corridor_block
from test_attitudes import with_attitudes
from test_correlated import flown as correlated
from test_distances import flown as with_distances
from with_effects import EVERY, OF_RIGS, ONE, at_scale, flown, started

import corridor
from corridor.core.adjustment import (
    Covariance,
    Design,
    LinearSystem,
    Loss,
    Normal,
    Sets,
    make_problem,
)
from corridor.core.adjustment.regression import point_regression
from corridor.core.camera import Camera
from corridor.core.effects import every_effect
from corridor.core.engine import interface
from corridor.core.engine.memory import InPlace
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

# What ties, or a rig that hangs together to a micrometre, leave of digits: the equations agree to
# 1e-9 like all others, but their least eigenvalue, with ones on the diagonal, is 2e-11 (measured);
# rounding, 2e-16, over that is 1e-5 of a variance, and it is met more than once.
TIED = 5e-5
NOISE = dict(tie_px=0.3, mark_px=0.3, gnss_m=0.02, control_m=0.005, seed=4)
EFFECTS = {effect.slug: effect for effect in every_effect()}


def with_each(monkeypatch, work):
    """What `work` returns with the one engine and with the other."""
    found = []
    for name in interface.NAMES:
        monkeypatch.setenv(interface.VARIABLE, name)
        assert interface.engine().name == name
        found.append(work())
    return found


def same(ours, theirs, size=None, within=1e-9):
    """To 1e-9 of their sizes, the largest of all by default."""
    ours, theirs = np.asarray(ours, float), np.asarray(theirs, float)
    assert ours.shape == theirs.shape
    size = np.abs(theirs).max(initial=1e-300) if size is None else size
    assert np.isfinite(ours).all() and np.abs((ours - theirs) / size).max(initial=0.0) < within


def products(sigma):
    return sigma[..., :, None] * sigma[..., None, :]


def sigmas(matrix):
    return np.sqrt(np.einsum("...ii->...i", matrix))


class Known:
    """Covariances of what is shared, poses, points and between them, all asked for at once: what
    an engine has not made yet another would make."""

    def __init__(self, of):
        self.shared, self.poses, self.poses_shared = of.shared, of.each_pose, of.poses_shared
        every = range(len(self.shared))
        self.points, self.points_shared = of.each_point, of.between(slice(None), every)
        self.few = of.between(np.arange(0, len(self.points), 7), every[:1])

    def agrees(self, other, within):
        """To so much of the standard deviations."""
        shared, pose = sigmas(other.shared), sigmas(other.poses)
        point = np.sqrt(other.points[:, [0, 2, 5]])
        both = point[:, [0, 1, 1, 2, 2, 2]] * point[:, [0, 0, 1, 0, 1, 2]]
        same(self.shared, other.shared, products(shared), within)
        same(self.poses, other.poses, products(pose), within)
        same(self.poses_shared, other.poses_shared, pose.reshape(-1, 1) * shared, within)
        same(self.points, other.points, both, within)
        same(self.points_shared, other.points_shared, point[:, :, None] * shared, within)
        same(self.few, other.points_shared[::7, :, :1], point[::7, :, None] * shared[:1], within)


# --- the equations, with every effect -----------------------------------------------------------


def held(block, slugs):
    """Priors that hold every parameter of the effects about as well as its size."""
    priors = {}
    for slug in slugs:
        for parameter in EFFECTS[slug].parameters(block):
            priors[f"{slug}.{parameter.name}"] = (0.0, parameter.scale)
    return priors


def equations(block, slugs, loss, storage):
    """What a system says at a state beside the start, with every effect switched on."""
    problem = make_problem(block, camera="f,k1,p1,b2", effects=slugs, priors=held(block, slugs))
    system = LinearSystem(problem, started(problem, at_scale(block, slugs)), loss, storage=storage)
    size, step = np.sqrt(system.reference), system.step()
    matrix = system.matrix.toarray() / products(size)
    seen = system.residuals().pixels
    numbers = system.right / size, matrix, size, seen, step.points, step.centre
    return numbers, Known(Covariance(system))


@pytest.mark.parametrize(
    ("slugs", "loss", "storage"),
    [pytest.param([slug], "squares", "band", id=slug) for slug in EVERY]
    + [
        pytest.param(ONE, "squares", "band", id="all at once"),
        pytest.param(ONE, "huber:2", "sparse", id="all at once, Huber, sparse"),
        pytest.param(["rolling_shutter"], "cauchy:2", "band", id="rolling_shutter, Cauchy"),
    ],
)
def test_equations_steps_and_covariances_with_every_effect(slugs, loss, storage, monkeypatch):
    block = add_noise(flown(slugs, start_error=(0.02, 0.0005, 0.02)), **NOISE)
    (ours, our_known), (theirs, known) = with_each(
        monkeypatch, lambda: equations(block, slugs, Loss.parse(loss), storage)
    )
    # All effects at once hardly differ from each other: 2e-9 is what rounding leaves.
    within = TIED if set(slugs) & set(OF_RIGS) else 1e-9 if len(slugs) == 1 else 1e-8
    for one, other in zip(ours[:4], theirs[:4], strict=True):
        same(one, other)
    for one, other in zip(ours[4:], theirs[4:], strict=True):
        same(one, other, within=within)
    our_known.agrees(known, within)


# --- whole adjustments ----------------------------------------------------------------------------


def strip(**options):
    small = dict(images=12, strips=2, observations_per_image=40, control=3, check=2, seed=1)
    return add_noise(corridor_block(**small | options), **NOISE)


# 131 degrees across; decentred and affine as well.
ACTION = Camera.from_table(
    "action",
    {"width": 4000, "height": 3000, "f": 1760.0, "model": "fisheye", "k1": 0.03, "k2": -0.01,
     "k3": 0.004, "k4": -0.001, "p1": 2e-4, "p2": -1e-4, "b1": 3e-4, "b2": -2e-4},
)  # fmt: skip
RIG = add_noise(rigged_block(exposures=6, points=400), tie_px=0.5, mark_px=0.5, gnss_m=0.02, seed=2)
BLOCKS = {
    "a free camera and a lever arm": (strip(), {}),
    "rows, image and antenna": (
        strip(angular_rate_deg_s=3.0),
        {"effects": ["rolling_shutter", "row_polynomial", "gnss_bias"], "lever_arm": "fixed"},
    ),
    "a fisheye": (
        strip(camera=ACTION, angular_rate_deg_s=3.0),
        {"camera": "f,cx,cy,k1,k2,k3,k4,p1,p2,b1,b2", "effects": ["rolling_shutter", "refraction"]},
    ),
    "an unknown of each image": (
        strip(),
        {"effects": ["time_rounding"], "priors": {"time_rounding.offset": (0.0, 0.2)}},
    ),
    "ground that is off": (
        strip(),
        {"effects": ["control_datum"], "lever_arm": "fixed",
         "priors": {f"control_datum.{axis}": (0.0, 0.02) for axis in "xyz"}},
    ),
    "Huber": (strip(), {"loss": "huber:2"}),
    "Cauchy": (strip(), {"loss": "cauchy:2"}),
    "a free network": (strip(gnss=False, control=0, check=0), {"camera": "fixed"}),
    "measurements that are correlated": (correlated(), {"effects": ["rolling_shutter"]}),
    "distances, free": (with_distances(), {"camera": "f,k1"}),
    "distances, with control": (with_distances(free=False), {"camera": "f,k1"}),
    "attitudes": (with_attitudes(strip()), {"effects": ["boresight"]}),
    "a head of three cameras": (RIG, {}),
}  # fmt: skip


def adjusted(block, options):
    found = corridor.adjust(block, **options)
    table = found.reliability.summary.select_dtypes("number").to_numpy()
    return found, found.point_sigma.mean(), table, Known(found.covariance)


HANGING = {"distances, free", "distances, with control", "a head of three cameras"}


@pytest.mark.parametrize("name", BLOCKS)
def test_an_adjustment(name, monkeypatch):
    block, options = BLOCKS[name]
    (ours, _, our_table, our_known), (theirs, point, table, known) = with_each(
        monkeypatch, lambda: adjusted(block, options)
    )
    assert ours.converged and theirs.converged
    assert ours.iterations == theirs.iterations
    within = TIED if name in HANGING else 1e-9
    assert ours.sigma0 == pytest.approx(theirs.sigma0, rel=1e-9)
    # Of coordinates far from zero the standard deviation says it better.
    for one, other in ((ours.state.centre, theirs.state.centre),
                       (ours.state.points, theirs.state.points)):  # fmt: skip
        same(one, other)
        same(one, other, point, within=1e-7)
    for key, one in theirs.parameters.items():
        mine, least = ours.parameters[key], 1e-7 * (one.sigma or 0.0)
        assert mine.value == pytest.approx(one.value, rel=1e-9, abs=least), key
        assert mine.sigma == pytest.approx(one.sigma, rel=within, nan_ok=True), key
    our_known.agrees(known, within)
    assert our_table == pytest.approx(table, rel=max(within, 1e-7), nan_ok=True)


# --- many right sides ---------------------------------------------------------------------------


def passed(block):
    problem = make_problem(block, camera="f,k1", effects=["gnss_bias", "control_datum"])
    system, rng = LinearSystem(problem, problem.start), np.random.default_rng(1)
    design = Design(system, followed=[5, 9])
    image = [rng.normal(size=2 * len(problem.img)) for _ in range(3)]
    control = 0.01 * rng.normal(size=(3 * len(problem.control_given), 3))
    step = 1e-3 * rng.normal(size=(len(system.columns), 3))
    right = design.right(Sets(image, control))
    sets, moved, square = design.back(Sets(image, control), step)
    gains = point_regression(system, np.arange(0, len(problem.ptr) - 1, 3))
    return right, np.array(sets.image), sets.control, moved, square, gains.own, gains.gain.toarray()


def test_many_right_sides_and_the_regression_of_points(monkeypatch):
    for ours, theirs in zip(*with_each(monkeypatch, lambda: passed(strip())), strict=True):
        same(ours, theirs)


# --- which engine -------------------------------------------------------------------------------


def test_an_engine_that_is_none_is_refused(monkeypatch):
    monkeypatch.setenv(interface.VARIABLE, "fast")
    with pytest.raises(InputError, match="CORRIDOR_ENGINE is 'fast': use panels or plain"):
        interface.engine()


def test_without_numba_the_plain_engine_finds_the_same_and_one_sentence_says_so(tmp_path):
    root = Path(corridor.__file__).parents[1]
    script = "import sys\n{}\nimport corridor\nfound = corridor.adjust('data_synthetic/dike')\n"
    script += "print(float(found.sigma0), float(found.point_sigma.sum()))"
    said = [
        subprocess.run(
            [sys.executable, "-c", script.format(line)], cwd=root, capture_output=True, text=True
        )
        for line in ("sys.modules['numba'] = None", "")
    ]
    without, with_it = ([float(word) for word in one.stdout.split()] for one in said)
    assert len(without) == 2 and without == pytest.approx(with_it, rel=1e-9)
    assert said[0].stderr.count("numba cannot be used") == 1
    assert "install numba 0.64 to 0.68 for large blocks" in said[0].stderr
    assert not said[1].stderr


@pytest.mark.slow
def test_the_adjustments_tests_pass_with_the_plain_engine():
    """Of what equations are, and of what they give; `panels` is seven times as fast.

    All that are short there but for their seconds: of the shortest alone a sixth would be run. It
    has one thread, and long ways to the same numbers are ways of the same equations.
    """
    names = ("truth", "solve", "covariance", "correlated")
    files = [Path(__file__).with_name(f"test_{name}.py") for name in names]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not slow",
         "-k", "not two_threads and not valley and not TestNoise", *map(str, files)],
        cwd=Path(corridor.__file__).parents[1], capture_output=True, text=True,
        env=os.environ | {interface.VARIABLE: "plain", "CORRIDOR_SECONDS": "0"},
    )  # fmt: skip
    assert run.returncode == 0, run.stdout[-3000:]
    assert int(re.search(r"(\d+) passed", run.stdout)[1]) > 100


# --- one thing in place of another --------------------------------------------------------------


class TestInPlace:
    def made(self):
        asked = []

        def make(name):
            return lambda before: asked.append((name, before)) or f"{name} of {before}"

        return InPlace(equations=make("equations"), factor=make("factor")), asked

    def test_what_has_gone_is_made_anew(self):
        memory, asked = self.made()
        assert memory.get("factor") == memory.get("factor") == "factor of equations of None"
        assert len(asked) == 2
        assert memory.get("equations") == "equations of None" and len(asked) == 3

    def test_what_is_taken_is_nobody_elses(self):
        memory, asked = self.made()
        memory.put("factor", "mine")
        assert memory.take("factor") == "mine" and not asked
        assert memory.get("factor") == "factor of equations of None"

    def test_what_fails_to_be_made_leaves_nothing_spoilt(self):
        memory, asked = self.made()
        memory._makers["factor"] = lambda before: 1 / 0
        for _ in range(2):
            with pytest.raises(ZeroDivisionError):
                memory.get("factor")
        assert asked == [("equations", None)] * 2


@pytest.mark.parametrize("storage", ["band", "sparse"])
@pytest.mark.parametrize("name", interface.NAMES)
def test_a_factor_whose_place_is_taken_finds_no_wrong_numbers(name, storage, monkeypatch):
    monkeypatch.setenv(interface.VARIABLE, name)
    problem = make_problem(strip())
    normal = Normal(problem, Loss(), storage=storage)
    normal.assemble(problem.start, 0.0)
    factor = normal.factor()
    right = np.ones((problem.image_count * problem.d, 1)), np.ones((problem.shared_count, 1))
    before = factor.solve(*right)
    normal.assemble(problem.start, 0.0)
    with pytest.raises(RuntimeError, match="the factor is gone"):
        factor.solve(*right)
    after = normal.factor().solve(*right)
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
