"""Antenna positions that contradict what is stated of them, and what they share."""

import numpy as np
import pytest
from strips import corridor_block

import corridor
from benchmarks.diagnosis.generator.cases import Case
from benchmarks.diagnosis.generator.generate import generate
from corridor.core.adjustment.variance_components import _Contrasts, _likeliest
from corridor.core.gnss import SlowNoise

TRUE = np.array([0.02, 0.02, 0.04])


def flown(seed=0, images=36, strips=3, control=5, scatter=TRUE, **options):
    block = corridor_block(
        images=images, strips=strips, observations_per_image=60, seed=seed, control=control,
        check=6, **{"turned": True, "lever_arm": (0.1, -0.05, 0.35)} | options,
    )  # fmt: skip
    block = corridor.simulation.add_noise(block, tie_px=0.5, control_m=0.005, seed=seed)
    rng = np.random.default_rng(seed)
    block.gnss[["x", "y", "z"]] += rng.normal(0, 1, (len(block.gnss), 3)) * scatter
    block.gnss[["sx", "sy", "sz"]] = scatter
    block.lever_arm, block.lever_arm_fixed = {}, False
    return block


class TestCoarseOnesThatAreFine:
    @pytest.mark.parametrize("stated", [0.4, 1.0, 3.0])
    def test_their_scatter_is_found_and_the_arm_is_estimated(self, stated):
        """Whatever is stated: the arm is no noise, and no reason to hold the arm."""
        block = flown()
        block.gnss[["sx", "sy", "sz"]] = stated
        found = corridor.adjust(block)
        sigma = found.problem.block.gnss_sigma()[0]
        # Chi-square of some 60 and 30 numbers: 25 and 35 % in 99 %.
        assert sigma[0] == pytest.approx(TRUE[0], rel=0.25)
        assert sigma[2] == pytest.approx(TRUE[2], rel=0.35)
        assert found.problem.arms_free
        arm = found.lever_arm[["x", "y"]].to_numpy()
        assert np.abs(arm - [0.1, -0.05]).max() < 0.03
        right = corridor.adjust(flown())
        assert found.check_rms.d3 < 1.2 * right.check_rms.d3


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.01, 0.001])
def test_those_stated_far_too_well_are_weighted_as_they_scatter(factor):
    """They bend the images, and have no residuals left: check points were twice as far off."""
    block = flown()
    block.gnss[["sx", "sy", "sz"]] = factor * TRUE
    found = corridor.adjust(block)
    sigma = found.problem.block.gnss_sigma()[0]
    assert sigma[0] == pytest.approx(TRUE[0], rel=0.25)
    assert sigma[2] == pytest.approx(TRUE[2], rel=0.35)
    assert [note for note in found.warnings if "contradict the stated" in note]
    assert found.check_rms.d3 < 1.2 * corridor.adjust(flown()).check_rms.d3


class TestOneBlockOfFalsePositions:
    OFF = np.array([0.25, -0.15, 0.40])

    def false(self, count=9, of=36):
        block = flown(images=of)
        block.gnss.loc[12 : 12 + count - 1, ["x", "y", "z"]] += self.OFF
        return block, set(block.gnss["image"].iloc[12 : 12 + count])

    def test_they_are_told_and_the_rest_is_as_good_as_without(self):
        block, false = self.false()
        found = corridor.adjust(block)
        told = next(s for s in found.warnings if "disagree with all others by one vector" in s)
        assert told.startswith(f"{len(false)} GNSS positions") and "--reject-gnss" in told
        clean = corridor.adjust(flown())
        assert found.check_rms.z < clean.check_rms.z + 0.005
        scaled = found.problem.block.gnss_sigma()[:, 0] > 1.5 * TRUE[0]
        assert set(found.problem.block.gnss["image"][scaled]) == false
        table = found.variance_components.query("kind == 'gnss'")
        assert table["sigma0"].max() < 1.6

    def test_they_are_left_out_where_that_is_asked_for(self):
        block, false = self.false()
        kept = corridor.adjust(block, reject_gnss=True).residuals["gnss"]["image"]
        assert set(block.gnss["image"]) - set(kept) == false

    def test_single_ones_are_left_out_too(self):
        """Six of 36, each off by another vector."""
        block, rows = flown(), [3, 8, 13, 20, 26, 31]
        off = np.random.default_rng(2).normal(0.0, 0.4, (6, 3))
        block.gnss.loc[rows, ["x", "y", "z"]] += off
        kept = corridor.adjust(block, reject_gnss=True).residuals["gnss"]["image"]
        assert set(block.gnss["image"]) - set(kept) == set(block.gnss["image"].iloc[rows])

    @pytest.mark.parametrize(
        ("where", "off"),
        [
            (slice(27, 36), (0.25, -0.15, 0.40)),
            (slice(0, 8), (0.0, 0.0, 0.6)),
            (slice(13, 17), (0.5, 0.4, 0.0)),
            ([4, 5, 6, 7, 28, 29, 30, 31], (-0.25, 0.15, 0.40)),
            (slice(18, 29), (0.5, -0.3, 0.8)),
        ],
    )
    def test_wherever_they_are_and_whichever_way_off(self, where, off):
        block = flown()
        names = set(block.gnss["image"].iloc[where])
        block.gnss.loc[block.gnss["image"].isin(names), ["x", "y", "z"]] += np.array(off)
        found = corridor.adjust(block)
        told = next(s for s in found.warnings if "disagree with all others by one vector" in s)
        assert told.startswith(f"{len(names)} GNSS positions")
        assert found.check_rms.z < corridor.adjust(flown()).check_rms.z + 0.005

    def test_stated_weights_stay_where_they_are_asked_for(self):
        block, _ = self.false()
        found = corridor.adjust(block, weights="stated")
        assert (found.problem.block.gnss_sigma() == TRUE).all()
        assert found.variance_components.query("kind == 'gnss'")["sigma0"].max() > 3

    def test_other_weights_are_refused(self):
        with pytest.raises(corridor.InputError, match="use estimated, marks, stated"):
            corridor.adjust(flown(), weights="mine")


class TestWhatAllShare:
    def test_coarse_positions_that_share_an_error_do_not_bend_the_block(self):
        """Control at one end; the sigma of the check points is right within a factor."""
        pulls = []
        for seed in range(3):
            block = flown(seed, images=40, strips=2, control=10, scatter=np.array([1.0, 1.0, 2.0]),
                          lever_arm=(0.0, 0.0, 0.0))  # fmt: skip
            block.gnss[["x", "y", "z"]] += [1.5, -2.0, 4.0]
            control = block.ground[block.ground["role"] == "control"].sort_values("x")["point"]
            found = corridor.adjust(block, control=control.tolist()[:4])
            assert any("disagree by one vector" in s for s in found.warnings)
            check = found.check_points
            pulls.append(check[["dx", "dy", "dz"]].to_numpy() / check[["sx", "sy", "sz"]])
        assert np.sqrt(np.mean(np.square(np.concatenate(pulls)))) < 1.7

    @pytest.mark.parametrize(
        "vector", [(30.0, 0, 0), (0, 0, 45.0), (0, -0.5, 0), (-1.0, 1.0, 0), (0.2, 0, 0)]
    )
    def test_two_datums_are_told_and_control_decides(self, vector):
        block = flown(lever_arm=(0.0, 0.0, 0.0))
        block.lever_arm, block.lever_arm_fixed = {"default": (0.0, 0.0, 0.0)}, True
        block.gnss[["x", "y", "z"]] += np.array(vector, float)
        found = corridor.adjust(block)
        told = next(s for s in found.warnings if "GNSS and ground control disagree" in s)
        assert "another datum" in told
        values = found.effects.query("slug == 'gnss_bias' or slug == 'gnss_bias@flight'")
        off = values["value"].to_numpy().reshape(-1, 3) - vector
        assert np.abs(off).max() < 0.1
        assert found.check_rms.d3 < 0.05

    @pytest.mark.parametrize(
        "vector", [(30.0, 0, 0), (0, 0, 45.0), (0, -0.5, 0), (-1.0, 1.0, 0), (0.5, 0, 0)]
    )
    def test_blunders_of_every_point_that_are_one_vector_are_no_blunders(self, vector):
        block = flown(lever_arm=(0.0, 0.0, 0.0))
        block.lever_arm, block.lever_arm_fixed = {"default": (0.0, 0.0, 0.0)}, True
        block.gnss[["x", "y", "z"]] += np.array(vector, float)
        found = corridor.adjust(block, effects=["control_blunder"])
        assert any("the datum is wrong, not single points" in s for s in found.warnings)


class TestSurveyedTogether:
    def datum(self, groups=None):
        block = flown(lever_arm=(0.0, 0.0, 0.0), control=8)
        block.lever_arm, block.lever_arm_fixed = {"default": (0.0, 0.0, 0.0)}, True
        if groups:
            names = block.ground["point"].to_numpy()
            block.ground["group"] = [groups[k % len(groups)] for k in range(len(names))]
        return block

    @pytest.mark.parametrize(
        "vector", [(0, 0, 0.3), (0, 0, -0.3), (1.0, 0, 0), (0.2, -0.2, 0.2), (-0.5, 0.1, 0)]
    )
    def test_a_datum_moves_check_points_too(self, vector):
        block = self.datum()
        block.ground[["x", "y", "z"]] += np.array(vector, float)
        found = corridor.adjust(block, effects=["control_datum"])
        assert found.check_rms.d3 < 0.03

    def test_each_group_has_its_own(self):
        block = self.datum(groups=["A", "B"])
        block.ground.loc[block.ground["group"] == "B", "z"] += 0.3
        found = corridor.adjust(block, effects=["control_datum"])
        value = found.effects.query("parameter == 'z'").set_index("group")
        # Focal length and height are one in nadir images; what is between the groups is not.
        assert value["value"]["B"] - value["value"]["A"] == pytest.approx(0.3, abs=0.03)
        assert (np.abs(value["value"] - [0.0, 0.3]) < 4 * value["sigma"]).all()
        check = found.check_points["dz"].to_numpy()
        assert check.std() < 0.03

    def test_what_is_simulated_moves_them_and_correcting_undoes_it(self):
        block = self.datum(groups=["A", "B"])
        values = {"control_datum": {"z": {"A": 0.1, "B": -0.2}}}
        moved = corridor.effects.add(block, values)
        off = (moved.ground["z"] - block.ground["z"]).to_numpy()
        assert np.allclose(off, np.where(block.ground["group"] == "A", 0.1, -0.2))
        back = corridor.correct(moved, values)
        assert np.abs(back.ground["z"] - block.ground["z"]).max() < 1e-12

    def test_the_curvature_of_the_earth_bends_check_points(self):
        block = self.datum()
        moved = corridor.effects.add(block, {"earth_curvature": {"fraction": 1.0}})
        check = (block.ground["role"] == "check").to_numpy()
        middle = block.poses[:, :2].mean(axis=0)
        away = ((block.ground[["x", "y"]].to_numpy() - middle) ** 2).sum(axis=1)
        rise = (moved.ground["z"] - block.ground["z"]).to_numpy()
        assert np.allclose(rise[check], (away / 2 / 6.371e6)[check], atol=1e-9)


class TestErrorsThatLast:
    """RTK that drifts by centimetres for a minute, in a flight of ten."""

    def drifting(self, size, seed):
        block = flown(seed, images=60, strips=3, control=4, lever_arm=(0.0, 0.0, 0.0))
        block.lever_arm, block.lever_arm_fixed = {"default": (0.0, 0.0, 0.0)}, True
        time = 10.0 * np.arange(len(block.images))
        block.images["time_s"] = time
        drift = SlowNoise(60.0).draw(time, np.random.default_rng(seed), axes=3)
        block.gnss[["x", "y", "z"]] += size * drift
        return block

    def test_they_are_found_and_told(self):
        found = corridor.adjust(self.drifting(0.06, 1))
        told = next(s for s in found.warnings if "errors of one position and the next" in s)
        assert "RTK" in told
        # Sixty seconds of ten each: some twelve positions know as much as one.
        white, slow, alike = 0.02, 0.06, 12.0
        right = np.sqrt(white**2 + slow**2 * alike) / white
        factor = found.problem.block.gnss_sigma()[0, 0] / TRUE[0]
        assert 0.5 * right < factor < 2.0 * right

    def test_independent_ones_are_weighted_as_stated(self):
        """Chance takes one block of a thousand for slow."""
        for seed in range(4):
            found = corridor.adjust(self.drifting(0.0, seed))
            assert (found.problem.block.gnss_sigma() == TRUE).all()

    def test_the_likelihood_finds_the_size_and_how_long(self):
        """Residuals that are the errors themselves: nothing else is estimated beside them."""
        draw, time = np.random.default_rng(5), 4.0 * np.arange(100)
        parts = [
            _Contrasts(
                time,
                np.eye(100),
                draw.normal(0, 1.0, 100) + 2.0 * SlowNoise(60.0).draw(time, draw)[:, 0],
            )
            for _ in range(6)
        ]
        ratio, constant, white = _likeliest(parts)
        assert 1.8 < ratio < 9.0 and 30.0 <= constant <= 120.0 and white == pytest.approx(1, 0.15)
        still = [one._replace(u=draw.normal(0, 1.0, 100)) for one in parts]
        assert _likeliest(still) is None


def test_false_positions_that_draw_all_others_after_them_are_found_too():
    """One strip, no control: the roll follows whatever is off, and the best fit is wrong."""
    case = Case({}, images=24, strips=1, observations=120, control=0, check=4)
    block = generate(case, 68).block.copy()
    right = corridor.adjust(block).check_rms.d3
    false = block.gnss.index[8:14]
    block.gnss.loc[false, ["x", "y", "z"]] += [0.4, 0.2, -0.5]
    found = corridor.adjust(block)
    told = [note for note in found.notes if "disagree with all others by one vector" in note]
    assert len(told) == 1 and told[0].startswith("6 GNSS positions")
    assert found.check_rms.d3 < 2.0 * right
