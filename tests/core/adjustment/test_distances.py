"""Distances between points as observations, against a dense adjustment and against many draws."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from dense_jacobian import jacobian
from strips import corridor_block

import corridor
from corridor.core.adjustment import Loss, Model, Normal, make_problem
from corridor.core.adjustment.distances import END, ENDS
from corridor.core.errors import InputError
from corridor.diagnosis.bootstrap.replicate_block import counterpart
from corridor.diagnosis.bootstrap.replicator import Replicator
from corridor.tools.change.together import joined


def flown(seed=1, free=True, bars=3, noise=True, sigma=0.002, **options):
    """A block with bars between ties that many images show; without control and GNSS if free."""
    asked = {"gnss": False, "control": 0, "check": 2} if free else {"control": 3, "check": 2}
    block = corridor_block(
        images=10, strips=2, observations_per_image=60, seed=seed, relief=8.0, **asked | options
    )
    rays = block.tie_points["point"].value_counts()
    names = sorted(rays.index[rays >= 4].astype(str))[: 2 * bars]
    at = block.points.set_index("point").loc[names, ["x", "y", "z"]].to_numpy(float)
    length = np.linalg.norm(at[::2] - at[1::2], axis=1)
    if noise:
        random = np.random.default_rng(seed)
        length = length + sigma * random.standard_normal(len(length))
        block = corridor.simulation.add_noise(
            block, tie_px=0.5, mark_px=0.5, gnss_m=0.02, control_m=0.01, seed=seed
        )
    table = {"from": names[::2], "to": names[1::2], "distance": length, "sigma": sigma}
    return block.with_(distances=pd.DataFrame(table))


def dense(adjusted):
    """Covariance for unit weight by a Jacobian without the trick: points tied by their distance.

    A free network: the pseudo-inverse, of which differences and the camera are used.
    """
    state = adjusted.state
    bare = adjusted.problem.block.with_(distances=None)
    p = make_problem(bare, adjusted.problem.model)
    effects = {key: value for key, value in state.effects.items() if key != ENDS}
    j = jacobian(replace(state, effects=effects), p)
    j = j[np.abs(j).sum(axis=1) > 0]  # the rows of priors, of which there are none
    first = p.image_count * p.d + p.shared_count
    points = {name: k for k, name in enumerate(p.point_names)}
    for row in adjusted.problem.block.distances.itertuples(index=False):
        one, other = points[row[0]], points[row[1]]
        apart = state.points[one] - state.points[other]
        unit = apart / np.linalg.norm(apart) / row[3]
        line = np.zeros(j.shape[1])
        line[first + 3 * one : first + 3 * one + 3] = unit
        line[first + 3 * other : first + 3 * other + 3] = -unit
        j = np.vstack([j, line])
    scale = np.linalg.norm(j, axis=0)
    inverse = np.linalg.pinv(j / scale, rcond=1e-10)
    return (inverse @ inverse.T) / scale[:, None] / scale, j


class TestAgainstADenseAdjustment:
    @pytest.mark.parametrize("free", [True, False])
    def test_sigmas_and_redundancies_are_those_of_a_dense_adjustment(self, free):
        adjusted = corridor.adjust(flown(free=free), camera="f,k1")
        assert adjusted.converged
        whole, j = dense(adjusted)
        p = adjusted.problem
        m = p.image_count * p.d
        mine = [n for n, one in enumerate(p.unknowns) if one.kind != END]
        ours = adjusted.covariance.shared[np.ix_(mine, mine)]
        theirs = whole[np.ix_(m + np.array(mine), m + np.array(mine))]
        size = np.sqrt(np.diag(theirs))
        # A tied point has a share 1e-6 of variance more.
        assert np.abs((ours - theirs) / size[:, None] / size).max() < 1e-5
        share = 1 - np.einsum("ij,jk,ik->i", j[-3:], whole, j[-3:])
        table = adjusted.distances
        assert table["redundancy"].to_numpy() == pytest.approx(share, abs=1e-5)
        rank = np.linalg.matrix_rank(j / np.linalg.norm(j, axis=0), tol=1e-9)
        assert adjusted.redundancy == len(j) - rank

    def test_the_sum_of_squares_is_at_its_least(self):
        """Moving a bar's ends together or apart makes it no smaller."""
        adjusted = corridor.adjust(flown(free=False), camera="fixed")
        v = adjusted.distances["v"] / adjusted.distances["sigma"]
        images = sum(
            float(np.sum(adjusted.residuals[kind][["vx", "vy"]].to_numpy() ** 2
                         / adjusted.residuals[kind]["sigma"].to_numpy()[:, None] ** 2))
            for kind in ("tie", "mark")
        )  # fmt: skip
        metres = sum(
            float(
                np.sum((t[["vx", "vy", "vz"]].to_numpy() / t[["sx", "sy", "sz"]].to_numpy()) ** 2)
            )
            for t in (adjusted.residuals["gnss"], adjusted.residuals["control"])
        )
        assert 2 * adjusted.cost == pytest.approx(images + metres + float(np.sum(v**2)), rel=1e-6)


class TestScale:
    @pytest.mark.parametrize("factor", [0.01, 1.0, 300.0])
    def test_a_free_network_gets_the_scale_of_its_bar(self, factor):
        block = flown(bars=1, noise=False)
        grown = block.copy()
        grown.images = grown.images.drop(columns=["vx", "vy", "vz"], errors="ignore")
        for table in ("images", "points", "ground"):
            frame = getattr(grown, table).copy()
            frame[["x", "y", "z"]] *= factor
            setattr(grown, table, frame)
        adjusted = corridor.adjust(grown, camera="fixed")
        row = adjusted.distances.iloc[0]
        assert abs(row["v"]) < 1e-6 * row["given"]
        at = adjusted.points.set_index("point")[["x", "y", "z"]]
        length = np.linalg.norm(at.loc[row["from"]] - at.loc[row["to"]])
        assert length == pytest.approx(row["given"], rel=1e-6)

    def test_one_bar_of_a_free_network_changes_no_residual_and_no_redundancy(self):
        with_bar = flown(bars=1)
        without = with_bar.with_(distances=None)
        one, other = corridor.adjust(with_bar), corridor.adjust(without)
        assert one.redundancy == other.redundancy
        assert one.sigma0 == pytest.approx(other.sigma0, rel=1e-6)
        assert one.distances["redundancy"].iloc[0] == pytest.approx(0.0, abs=1e-4)


class TestNoise:
    def test_w_of_good_bars_is_normal_and_a_wrong_bar_stands_out(self):
        found = []
        for seed in range(12):
            block = flown(seed=seed, free=False, bars=4, sigma=0.01)
            found += corridor.adjust(block, camera="fixed").distances["w"].tolist()
        assert 0.7 < np.std(found) < 1.3 and abs(np.mean(found)) < 0.5
        wrong = block.distances.copy()
        wrong.loc[2, "distance"] += 0.15
        w = corridor.adjust(block.with_(distances=wrong), camera="fixed").distances["w"]
        assert w.abs().idxmax() == 2 and w.abs().max() > 5


class TestWrongBars:
    @pytest.mark.parametrize(
        ("bars", "wrong"), [(6, [2]), (6, [0, 4]), (5, [1, 3]), (1, [0]), (6, [])]
    )
    def test_they_are_named_with_their_error_and_no_other(self, bars, wrong):
        block = flown(free=False, bars=bars, sigma=0.01, seed=2)
        table = block.distances.copy()
        table.loc[wrong, "distance"] += 0.4
        adjusted = corridor.adjust(block.with_(distances=table), camera="fixed")
        found = adjusted.wrong_distances
        assert sorted(found["from"]) == sorted(table.loc[wrong, "from"])
        assert ((found["error"] - 0.4).abs() < 4 * found["sigma"]).all()
        # What they push aside is not accused.
        assert not len(adjusted.reliability.wrong_control)
        told = [note for note in adjusted.warnings if note.startswith("Distances are wrong")]
        assert len(told) == bool(wrong)
        assert all(f"{name} to" in told[0] for name in table.loc[wrong, "from"])
        row = next(line for line in str(adjusted).splitlines() if line.startswith("  distances "))
        assert row.split()[1] == str(bars)


class TestFiles:
    def test_they_are_written_and_read_and_said(self, tmp_path):
        block = flown()
        block.write(tmp_path / "block")
        again = corridor.read(tmp_path / "block")
        pd.testing.assert_frame_equal(again.distances, block.distances)
        adjusted = corridor.adjust(again, camera="fixed")
        assert "Distances" in str(adjusted) and len(adjusted.to_dict()["distances"]) == 3
        assert "distances" in str(corridor.summary(again))
        assert len(adjusted.block.distances) == 3

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            ({"distance": -1.0}, "not positive"),
            ({"to": None}, "to is empty"),
            ({"sigma": 0.0}, "not a standard deviation"),
        ],
    )
    def test_a_wrong_row_is_refused_by_its_number(self, tmp_path, change, said):
        block = flown()
        table = block.distances.copy()
        for name, value in change.items():
            table.loc[1, name] = value
        with pytest.raises(InputError, match=said) as raised:
            block.with_(distances=table).check()
        assert "distances.csv, row 3" in str(raised.value)

    def test_a_block_without_distances_has_an_empty_table(self):
        adjusted = corridor.adjust(flown(free=False).with_(distances=None), camera="fixed")
        assert len(adjusted.distances) == 0 and adjusted.to_dict()["distances"] == []
        assert "Distances" not in str(adjusted)

    def test_ends_that_no_image_shows_or_control_holds_are_told(self):
        block = flown(free=False)
        control = block.ground.loc[block.ground["role"] == "control", "point"].iloc[0]
        table = block.distances.copy()
        table.loc[0, "to"], table.loc[1, "to"] = "nowhere", control
        adjusted = corridor.adjust(block.with_(distances=table), camera="fixed")
        said = " ".join(adjusted.notes)
        assert "nowhere" in said and "no image shows" in said and control in said
        assert len(adjusted.distances) == 1

    def test_a_part_of_a_block_keeps_the_distances_of_its_points(self):
        block = flown()
        names = block.images["image"].iloc[:4].tolist()
        part = block.select(images=names)
        measured = set(part.tie_points["point"].astype(str))
        for row in part.distances.itertuples(index=False):
            assert {row[0], row[1]} <= measured


class TestWrongDistances:
    def test_the_error_of_one_is_what_an_adjustment_without_it_misses(self):
        block = flown(free=False, sigma=0.02)
        wrong = block.copy()
        wrong.distances.loc[1, "distance"] += 0.3
        found = corridor.adjust(wrong, camera="f,k1", effects=["distance_blunder"])
        row = found.effects.iloc[1]
        # Beside an error of its own a distance says nothing.
        alone = corridor.adjust(wrong.with_(distances=None), camera="f,k1")
        ends = wrong.distances.iloc[1]
        at = alone.block.points.set_index("point").loc[[ends["from"], ends["to"]]]
        length = np.linalg.norm(np.diff(at[["x", "y", "z"]].to_numpy(float), axis=0))
        assert row["value"] == pytest.approx(ends["distance"] - length, abs=1e-4)

    @pytest.mark.parametrize("free", [True, False])
    def test_a_diagnosis_names_a_wrong_one_with_its_value(self, free):
        block = flown(free=free, bars=6, sigma=0.02)
        block.distances.loc[2, "distance"] += 0.2
        only = ["distance_blunder", "distance_scale", "rolling_shutter", "control_blunder"]
        (found,) = corridor.diagnose(block, camera="f,k1", only=only).findings.effects
        name = f"{block.distances['from'][2]} to {block.distances['to'][2]}"
        assert (found.slug, found.kind, found.where) == (
            "distance_blunder", "named", {"distance": name},
        )  # fmt: skip
        (error,) = found.parameters
        assert abs(error["value"] - 0.2) < 4 * error["sigma"] < 0.12

    def test_a_common_scale_is_told_where_control_knows_another(self):
        block = flown(free=False, bars=6, sigma=0.02)
        block = corridor.core.effects.add(block, {"distance_scale": {"scale": 2e4}})
        only = ["distance_blunder", "distance_scale", "rolling_shutter", "control_blunder"]
        (found,) = corridor.diagnose(block, camera="f,k1", only=only).findings.effects
        assert found.slug == "distance_scale"
        assert abs(found.parameters[0]["value"] - 2e4) < 4 * found.parameters[0]["sigma"]


class TestCounterparts:
    def test_they_draw_distances_with_their_sigma(self):
        adjusted = corridor.adjust(flown(bars=6, sigma=0.02), camera="f,k1")
        replicator = Replicator(adjusted)
        model = replicator.measured.distance - replicator.fit.distance
        rng = np.random.default_rng(0)
        drawn = np.stack([replicator.draw(rng).distance - model for _ in range(100)])
        # 600 numbers: their scatter is known to 3 %.
        assert drawn.std() == pytest.approx(0.02, rel=0.12)
        assert np.abs(drawn.mean(axis=0)).max() < 4 * 0.02 / 10

    def test_fits_of_them_are_those_of_the_adjustment(self):
        """A distance 3 mm longer leaves what the adjustment of such a block leaves."""
        block = flown(bars=6, sigma=0.02)
        replicator = Replicator(corridor.adjust(block, camera="f,k1"))
        more = replicator.measured
        more = more._replace(distance=more.distance + 0.003 * np.eye(6)[:, [2]])
        (fit,) = replicator.fits([more])
        system = replicator.system.measuring(distance=more.distance)
        again = system.at(system.step()).distance.residual
        assert fit.distance == pytest.approx(again, abs=1e-6)

    def test_a_counterpart_is_a_block_with_distances_of_its_own(self):
        adjusted = corridor.adjust(flown(bars=6, sigma=0.02), camera="f,k1")
        made = counterpart(adjusted, seed=1)
        off = made.distances["distance"] - adjusted.start.distances["distance"]
        assert 0.002 < np.abs(off).max() < 0.2
        assert corridor.adjust(made, camera="f,k1").converged


class TestTwoDates:
    def test_each_date_has_its_own(self):
        """A bar of one name in both is measured twice: each date has the scale of its own."""
        before, after = (flown(free=False, bars=6, sigma=0.02, seed=1) for _ in range(2))
        after.distances["distance"] += 0.001
        found = corridor.change(before, after, model=Model(camera="fixed"), surface=False)
        one, other = (adjusted.distances for adjusted in found.compared.adjustments)
        assert len(one) == len(other) == 6
        assert other["given"].to_numpy() == pytest.approx(one["given"].to_numpy() + 0.001)
        # What starts as the points do is no control of both dates.
        names = {name for table in (one, other) for name in (*table["from"], *table["to"])}
        assert not names & set(found.compared.joint.common_control)
        assert not any("distances.csv" in note for note in found.notes)

    def test_adjusted_together_they_keep_their_ends(self):
        before, after = (flown(free=False, bars=3, seed=1) for _ in range(2))
        both = joined(before, after, [])
        assert len(both.distances) == 6
        assert set(both.distances["from"]) <= set(both.points["point"].astype(str))


def test_a_cost_without_equations_is_that_of_the_equations_for_wrong_distances_and_a_robust_loss():
    block = flown(free=False)
    block.distances.loc[0, "distance"] += 0.5
    p = make_problem(block, Model(loss="huber:2"))
    normal = Normal(p, Loss.parse("huber:2"))
    normal.assemble(p.start, 0.0)
    assert normal.cost_at(p.start) == (pytest.approx(normal.cost, rel=1e-13), normal.behind)
