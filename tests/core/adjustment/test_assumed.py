"""What nobody measured: sigmas of positions, lever arms and focal lengths that are assumed."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from strips import corridor_block

import corridor
from corridor.core.adjustment import readjusting

SCATTER = np.array([0.3, 0.3, 0.6])


def surveyed(seed=0, scatter=SCATTER, late_s=0.0):
    """A flight whose positions scatter, stated to 3 and 6 m, without a lever arm."""
    block = corridor_block(images=24, strips=3, observations_per_image=60, seed=seed,
                           lever_arm=(0.0, 0.0, 0.0), turned=True)  # fmt: skip
    block = corridor.simulation.add_noise(block, tie_px=0.5, seed=seed)
    block.lever_arm, block.lever_arm_fixed = {}, False
    rng = np.random.default_rng(seed)
    block.gnss[["x", "y", "z"]] += rng.normal(0, 1, (len(block.gnss), 3)) * scatter
    speed = block.images.set_index("image").loc[block.gnss["image"], ["vx", "vy", "vz"]]
    block.gnss[["x", "y", "z"]] -= late_s * speed.to_numpy()
    block.gnss = block.gnss.assign(sx=3.0, sy=3.0, sz=6.0)
    return block


def free(block, **options):
    return corridor.adjust(block, camera="f,cx,cy,k1", control=[], **options)


class TestPositions:
    def test_assumed_metres_become_the_decimetres_they_scatter_by(self):
        """v'v / sigma^2 of 48 coordinates in plan lies within the 99.8 % of its chi square."""
        found = free(surveyed())
        sigma = found.problem.block.gnss_sigma()
        low, high = np.sqrt(chi2.ppf([0.001, 0.999], 40) / 40)
        assert low < sigma[0, 0] / SCATTER[0] < high
        told = next(s for s in found.warnings if s.startswith("GNSS: 3 m horizontally and 6 m"))
        assert f"scatter by {sigma[0, 0]:.2g} and {sigma[0, 2]:.2g} m" in told

    def test_metres_that_are_true_stay_as_they_are(self):
        found = free(surveyed(scatter=np.array([3.0, 3.0, 6.0])))
        assert (found.problem.block.gnss_sigma()[0] == [3.0, 3.0, 6.0]).all()
        assert not any("are assumed" in sentence for sentence in found.warnings)

    def test_an_arm_that_fine_ones_show_stays_free_where_they_turn_out_coarse(self):
        """Errors that last, of 0.3 m where 0.02 m is stated: the arm came out as 0, and nobody
        said so."""
        block = corridor.read("data_synthetic/dike")
        walk = np.random.default_rng(1).standard_normal((len(block.gnss), 3)).cumsum(axis=0)
        away = block.gnss[["x", "y", "z"]] + 0.3 * walk / np.sqrt(len(walk))
        found = corridor.adjust(block.with_(gnss=block.gnss.assign(**away)))
        assert found.problem.block.gnss_sigma()[0, 0] > 0.2
        assert found.problem.arms_free
        arm = found.lever_arm[["sx", "sy", "sz"]].to_numpy()
        assert 0.0 < arm.min() and arm.max() < 1.0

    def test_an_adjusted_block_keeps_what_was_found_and_no_arm(self, tmp_path):
        found = free(surveyed())
        found.save(tmp_path / "out")
        again = corridor.read(tmp_path / "out" / "block")
        assert again.gnss["sx"].iloc[0] < 1.0
        assert not again.lever_arm
        assert not free(again).problem.arms_free

    @pytest.mark.parametrize("late_s", [0.3, 0.0])
    def test_a_late_clock_is_named_and_nothing_is_to_be_left_out(self, late_s):
        found = free(surveyed(late_s=late_s))
        mine = [s for s in found.warnings if "behind the images along the flight" in s]
        assert len(mine) == bool(late_s)
        assert not late_s or "--effect clock_offset" in mine[0]


class TestFocalLength:
    def stated(self, value, sigma):
        block = surveyed()
        block.cameras = {
            name: replace(camera, extra={"f_stated": [value, sigma]})
            for name, camera in block.cameras.items()
        }
        return free(block)

    def test_what_photographs_state_is_a_prior(self):
        (name,) = surveyed().cameras
        known = self.stated(5495.0, 0.5).parameters[f"camera.{name}.f"]
        assert known.prior == (5495.0, 0.5)
        assert known.sigma < 0.5

    def test_a_prior_that_is_overruled_is_told(self):
        found = self.stated(9000.0, 100.0)
        assert any("sigmas from what is stated beforehand, 9000" in s for s in found.warnings)

    def test_a_value_without_sigma_is_refused(self):
        with pytest.raises(corridor.InputError, match="f_stated of camera .* as .1133.0, 34.0."):
            self.stated(5495.0, float("nan"))

    def test_it_is_one_and_the_same_while_positions_are_weighted(self, monkeypatch):
        """Else a shorter lens flattens the flight until it is as even as its positions.

        They are believed more for it, and 1,314 px ended at 42 on a real flight.
        """
        lengths, plain = [], readjusting.from_where_it_ended

        def watched(*given, **how):
            found = plain(*given, **how)
            lengths.append([camera["f"] for camera in found.block.cameras.values()])
            return found

        monkeypatch.setattr(readjusting, "from_where_it_ended", watched)
        found = free(surveyed())
        assert len(lengths) >= 2
        assert all(each == lengths[0] for each in lengths[:-1])
        assert lengths[-1] == [camera["f"] for camera in found.block.cameras.values()]
        assert lengths[-1] != lengths[0]


@pytest.mark.parametrize("late_s", [0.0, 1.0, 2.0])
def test_positions_that_are_late_are_told_without_velocities_and_where_most_fly_one_way(late_s):
    """Two of three strips go the same way: the block follows them, and the third alone is off."""
    block = corridor.read("data_synthetic/dike")
    block.images = block.images.drop(
        columns=[c for c in ("vx", "vy", "vz", "wx", "wy", "wz") if c in block.images]
    )
    speed = corridor.prepare(block).block.numbers("images", "vx", "vy", "vz")
    block.ground, block.marks = block.ground.iloc[:0], block.marks.iloc[:0]
    at = block.image_rows("gnss")
    noise = np.random.default_rng(1).normal(0, 0.5, (len(at), 3))
    block.put("gnss", ("x", "y", "z"), block.numbers("gnss", *"xyz") - late_s * speed[at] + noise)
    block.put("gnss", ("sx", "sy", "sz"), np.full((len(at), 3), 3.0))
    said = [
        s for s in corridor.adjust(block, lever_arm="fixed").warnings if "behind the images" in s
    ]
    assert len(said) == (late_s > 0)
    if said:
        value, sigma = map(float, re.search(r"are (\d+) \+- (\d+) ms", said[0]).groups())
        assert abs(value - 1000 * late_s) < 3 * sigma
