"""What must hold of every block: laws, tried on blocks by lot (`corridor.testing`).

Two runs that differ by rounding alone take the same steps. A coordinate of 3,000 m is known to
5e-13 m, which the weakest combination of unknowns of these blocks enlarges some thousand times: to
1e-6 of the smallest sigma, a millimetre.
"""

import numpy as np
import pandas as pd
import pytest

import corridor
from corridor import testing
from corridor.core.gnss import interpolate

hypothesis = pytest.importorskip("hypothesis", reason="hypothesis is not installed")
given, st = hypothesis.given, hypothesis.strategies

ROUNDING = 1e-6  # of a sigma
# Where weights differ, the steps do; the last one is below this many sigmas (`solving.solve`).
LAST_STEP = 5e-5
FEW = hypothesis.settings(
    max_examples=3, deadline=None, derandomize=True, database=None,
    suppress_health_check=list(hypothesis.HealthCheck), phases=(hypothesis.Phase.generate,),
)  # fmt: skip
XYZ, SXYZ = ["x", "y", "z"], ["sx", "sy", "sz"]
FEET = 1 / 0.3048


def same(value):
    return value


def compared(block, changed, place=same, names=None, sigmas=1.0, atol=ROUNDING, turned=False):
    """Both adjusted: centres of the cameras, largest difference in sigmas within `atol`."""
    one, two = corridor.adjust(block), corridor.adjust(changed)
    old, new = (adjusted.poses.set_index("image") for adjusted in (one, two))
    new = new.loc[old.index if names is None else [names[name] for name in old.index]]
    sigma, other = old[SXYZ].to_numpy(), new[SXYZ].to_numpy()
    off = (place(old[XYZ].to_numpy()) - new[XYZ].to_numpy()) / (sigmas * sigma)
    assert np.abs(off).max() < atol
    if turned:  # what a turn keeps of a covariance: of the height, and the sum of the others
        sigma, other = (
            np.column_stack([np.hypot(s[:, 0], s[:, 1]), s[:, 2]]) for s in (sigma, other)
        )
    assert np.allclose(other, sigmas * sigma, rtol=max(atol, 1e-6))
    return one, two


class TestAnAdjustment:
    @FEW
    @given(testing.blocks(), st.integers(0, 99))
    def test_does_not_see_the_order_of_rows(self, block, seed):
        compared(block, testing.shuffled(block, seed))

    @FEW
    @given(testing.blocks(), st.integers(0, 99))
    def test_does_not_see_names(self, block, seed):
        changed, names = testing.renamed(block, seed)
        compared(block, changed, names=names)

    @FEW
    @given(testing.blocks(), st.sampled_from([-1e5, 0.25, 3600.0]))
    def test_does_not_see_the_epoch_of_the_clock(self, block, seconds):
        compared(block, testing.later(block, seconds))

    @FEW
    @given(testing.blocks(), st.tuples(*[st.integers(-2000, 2000)] * 3))
    def test_moves_with_the_world(self, block, by):
        compared(block, testing.moved(block, by), lambda xyz: xyz + by)

    @FEW
    @given(testing.blocks(), st.sampled_from([33.0, 90.0, 180.0, 271.0]))
    def test_turns_with_the_world(self, block, degrees):
        a = np.radians(degrees)
        turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        compared(block, testing.turned(block, degrees), lambda xyz: xyz @ turn.T, turned=True)

    @FEW
    @given(testing.blocks())
    def test_is_mirrored_with_the_world(self, block):
        one, two = compared(block, testing.mirrored(block), lambda xyz: xyz * [-1, 1, 1])
        values = [
            adjusted.camera.set_index("parameter")["value"].to_dict() for adjusted in (one, two)
        ]
        assert values[0]["p1"] == pytest.approx(-values[1]["p1"], abs=1e-9)
        assert values[0]["p2"] == pytest.approx(values[1]["p2"], abs=1e-9)

    @FEW
    @given(testing.blocks())
    def test_has_no_unit_of_length(self, block):
        compared(block, testing.in_units(block, FEET), lambda xyz: FEET * xyz, sigmas=FEET)

    @FEW
    @given(testing.blocks(), st.sampled_from([0.8, 1.25]))
    def test_knows_sigmas_by_their_ratios(self, block, factor):
        """Sigmas a posteriori: sigma naught takes the factor up."""
        one, two = compared(block, testing.with_sigmas(block, factor), atol=LAST_STEP)
        assert one.sigma0 == pytest.approx(factor * two.sigma0, rel=1e-6)


class TestACorrection:
    @FEW
    @given(testing.blocks(noise=False), st.sampled_from([33.0, 180.0]))
    def test_of_a_turned_or_mirrored_block_is_that_of_the_block(self, block, degrees):
        """A shutter moves image points by what the camera does, wherever north is."""
        values = {"rolling_shutter": {"readout": 0.03}}
        plain = corridor.correct(block, values)
        turned = corridor.correct(testing.turned(block, degrees), values)
        pixels = [one.numbers("tie_points", "x", "y") for one in (plain, turned)]
        assert np.abs(pixels[0] - pixels[1]).max() < 1e-7  # px, of 4,000
        assert np.abs(pixels[0] - block.numbers("tie_points", "x", "y")).max() > 0.1
        mirrored = corridor.correct(testing.mirrored(block), values)
        back = testing.mirrored(mirrored).numbers("tie_points", "x", "y")
        assert np.abs(pixels[0] - back).max() < 1e-7


@st.composite
def tracks(draw):
    """A smooth flight at 5 Hz with noise of 2 cm, and moments between its epochs."""
    seed = draw(st.integers(0, 999))
    random = np.random.default_rng(seed)
    time = np.arange(0, 60, 0.2)
    sway = random.uniform(0.5, 2.0, 3)
    xyz = np.column_stack([5 * time, *(s * np.sin(0.2 * time + s) for s in sway[:2])])
    noise = 0.02 * random.standard_normal(xyz.shape)
    track = pd.DataFrame({"time_s": time}).assign(
        **dict(zip(XYZ, (xyz + noise).T, strict=True)), **dict.fromkeys(SXYZ, 0.02)
    )
    return track, np.sort(random.uniform(2, 58, 12))


class TestTheAntenna:
    """Of `gnss`: positions between epochs, sigmas of millimetres."""

    @FEW
    @given(tracks(), st.integers(0, 9))
    def test_does_not_see_the_order_of_what_is_asked(self, flown, seed):
        track, at = flown
        order = np.random.default_rng(seed).permutation(len(at))
        one, two = interpolate(track, at).table, interpolate(track, at[order]).table
        assert np.allclose(one[XYZ + SXYZ].to_numpy()[order], two[XYZ + SXYZ], rtol=0, atol=1e-9)

    @FEW
    @given(tracks(), st.sampled_from([-1e4, 86_400.0]))
    def test_moves_with_the_world_and_the_clock(self, flown, by):
        track, at = flown
        there = track.assign(x=track["x"] + by, time_s=track["time_s"] + by)
        one, two = interpolate(track, at).table, interpolate(there, at + by).table
        off = two[XYZ].to_numpy() - one[XYZ].to_numpy() - [by, 0, 0]
        # A time of a day is known to 1.5e-11 s, at 5 m/s; noise is found to a share of it.
        assert np.abs(off).max() < 1e-6
        assert np.allclose(one[SXYZ], two[SXYZ], rtol=1e-4)

    @FEW
    @given(tracks())
    def test_is_mirrored_with_the_world(self, flown):
        track, at = flown
        one, two = interpolate(track, at).table, interpolate(track.assign(y=-track["y"]), at).table
        assert np.allclose(one[XYZ] * [1, -1, 1], two[XYZ], rtol=0, atol=1e-9)
        assert np.allclose(one[SXYZ], two[SXYZ], rtol=1e-9)
