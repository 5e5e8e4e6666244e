"""Names and the order of rows mean nothing: the numbers stay the same."""

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.simulation import add_noise

TABLES = ("images", "tie_points", "points", "marks", "ground", "gnss")
# Another order of the sums leaves 1e-16 of the normal equations, 1e-11 m after the solution.
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def block():
    made = corridor_block(images=18, strips=3, flights=3, observations_per_image=60, seed=11,
                          start_error=(0.1, 0.002, 0.2))  # fmt: skip
    return add_noise(made, tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=11)


@pytest.fixture(scope="module", params=[[], ["rolling_shutter"], ["focal_drift@flight"]],
                ids=lambda effects: "+".join(effects) or "no effect")  # fmt: skip
def effects(request):
    return request.param


@pytest.fixture(scope="module")
def plain(block, effects):
    return corridor.adjust(block, effects=effects)


def shuffled(block, seed, tables=TABLES):
    out = block.copy()
    for n, table in enumerate(tables):
        rows = np.random.default_rng([seed, n]).permutation(len(getattr(out, table)))
        setattr(out, table, getattr(out, table).iloc[rows].reset_index(drop=True))
    return out


def renamed(block, name_of, columns):
    """The block with new names in these columns of all tables that have them."""
    out = block.copy()
    for table in TABLES:
        frame = getattr(out, table)
        for column in columns:
            if column in frame:
                kind = frame[column].dtype
                names = pd.Series([name_of[name] for name in frame[column]], dtype=object)
                frame[column] = pd.Categorical(names) if kind == "category" else names.astype("str")
    out.lever_arm = {name_of.get(name, name): arm for name, arm in out.lever_arm.items()}
    return out


def same(one, two, back=None):
    """Every result of two adjustments, laid side by side by name; back: new name -> old name."""
    back = back or {}
    assert two.redundancy == one.redundancy
    assert two.cost == pytest.approx(one.cost, rel=1e-9)

    def aligned(adjustment, table, key, columns, names):
        frame = getattr(adjustment, table)
        frame = frame.assign(**{key: [names.get(n, n) for n in frame[key]]})
        return frame.set_index(key)[columns].sort_index()

    for table, key, columns in (
        ("poses", "image", ["x", "y", "z", "sx", "sy", "sz", "s_rx", "s_ry", "s_rz"]),
        ("points", "point", ["x", "y", "z"]),
        ("check_points", "point", ["dx", "dy", "dz", "sx", "sy", "sz"]),
        ("lever_arm", "flight", ["x", "y", "z", "sx", "sy", "sz"]),
        ("effects", "group", ["value", "sigma"]),
    ):
        a = aligned(one, table, key, columns, {})
        b = aligned(two, table, key, columns, back)
        assert list(a.index) == list(b.index)
        np.testing.assert_allclose(b.to_numpy(float), a.to_numpy(float), rtol=1e-7, atol=ROUNDING)
    camera = two.camera["value"].to_numpy()
    np.testing.assert_allclose(camera, one.camera["value"].to_numpy(), rtol=0, atol=ROUNDING * 100)
    residuals = [a.residuals["tie"].copy() for a in (one, two)]
    for frame, names in zip(residuals, ({}, back), strict=True):
        frame["key"] = [
            (names.get(p, p), names.get(i, i))
            for p, i in zip(frame["point"], frame["image"], strict=True)
        ]
    a, b = (frame.set_index("key")[["vx", "vy"]].sort_index() for frame in residuals)
    np.testing.assert_allclose(b.to_numpy(), a.to_numpy(), rtol=0, atol=ROUNDING * 100)


class TestTheOrderOfRows:
    @pytest.mark.parametrize("table", TABLES)
    def test_of_one_file_means_nothing(self, block, effects, plain, table):
        same(plain, corridor.adjust(shuffled(block, 1, (table,)), effects=effects))

    @pytest.mark.parametrize("seed", [2, 3])
    def test_of_all_files_means_nothing(self, block, effects, plain, seed):
        same(plain, corridor.adjust(shuffled(block, seed), effects=effects))

    def test_of_strips_means_nothing(self, block, effects, plain):
        """The last strip first: the corridor is walked the other way."""
        turned = block.copy()
        turned.images = turned.images.iloc[::-1].reset_index(drop=True)
        same(plain, corridor.adjust(turned, effects=effects))

    def test_in_the_files_themselves_means_nothing(self, block, effects, plain, tmp_path):
        """Through the folder, where the names are coded anew."""
        shuffled(block, 4).write(tmp_path / "block")
        same(plain, corridor.adjust(corridor.read(tmp_path / "block"), effects=effects))


class TestNames:
    def test_of_points_mean_nothing(self, block, effects, plain):
        names = [*block.points["point"], *block.ground["point"]]
        turn = np.random.default_rng(5).permutation(len(names))
        name_of = {name: f"{k:05d}" for name, k in zip(names, turn, strict=True)}
        again = corridor.adjust(renamed(block, name_of, ["point"]), effects=effects)
        same(plain, again, {new: old for old, new in name_of.items()})

    def test_of_images_and_flights_mean_nothing(self, block, effects, plain):
        images = block.images["image"].tolist()
        name_of = {name: f"Ü {len(images) - k}" for k, name in enumerate(images)}
        name_of |= {"F1": "9", "F2": "evening", "F3": "1"}
        again = corridor.adjust(renamed(block, name_of, ["image", "flight"]), effects=effects)
        same(plain, again, {new: old for old, new in name_of.items()})
