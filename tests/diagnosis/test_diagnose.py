"""What is hidden is found, what is not there is not, and nothing that is missing stops it."""

import json
from functools import cache

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.adjustment import Model
from corridor.core.effects import add, find
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise
from corridor.diagnosis import ReferenceModel, diagnose


@cache
def _made(slugs=(), seed=1):
    block = corridor_block(
        images=24, strips=2, observations_per_image=150, control=6, check=4, relief=6.0,
        seed=seed, wind=2.0, height=(40.0, 70.0),
    )  # fmt: skip
    block.images["temperature_c"] = 20 + 8 * np.sin(np.arange(len(block.images)) / 4)
    block = add(block, {slug: dict(values) for slug, values in slugs})
    return add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.002, seed=seed)


def made(seed=1, **effects):
    """24 images with effects added, noise of 0.3 px, 1 cm GNSS and 2 mm control."""
    block = _made(tuple((k, tuple(v.items())) for k, v in effects.items()), seed).copy()
    block.sigma |= {"tie_px": 0.3, "mark_px": 0.3}
    block.sigma |= {"gnss_m": np.full(3, 0.01), "control_m": np.full(3, 0.002)}
    return block


@pytest.fixture(scope="module")
def shutter():
    return diagnose(made(rolling_shutter={"readout": 0.025}))


@pytest.fixture(scope="module")
def null():
    return diagnose(made())


def test_nothing_is_named_where_nothing_is_missing(null):
    assert null.verdict == "nothing"
    assert null.effects == [] and null.unknown == []


def test_the_size_of_the_tie_noise_is_that_which_was_drawn(null):
    """3,600 observations of 0.3 px: 1.2 % by chance, and what few rays leave open."""
    assert null.course.last.equations.scales.tie == pytest.approx(1.0, rel=0.05)


def test_nothing_missing_comes_with_the_smallest_effect_that_would_have_been_seen(null):
    """The readout that 24 images show is some milliseconds at most."""
    assert 1e-5 < null.detection_limits["rolling_shutter"]["readout"] < 0.02


def test_a_rolling_shutter_is_named_with_its_readout(shutter):
    assert shutter.verdict == "named"
    (found,) = shutter.effects
    assert found["slug"] == "rolling_shutter"
    (readout,) = found["parameters"]
    assert readout["unit"] == "s"
    assert abs(readout["value"] - 0.025) < max(4 * readout["sigma"], 0.00075)


def test_held_out_observations_are_predicted_better_with_the_effect(shutter):
    gap = shutter.to_dict()["gap"]
    assert gap["tie_px"]["after"] < gap["tie_px"]["before"]


def test_the_dictionary_is_json_with_finite_numbers(shutter, null):
    for one in (shutter, null):
        made = json.loads(json.dumps(one.to_dict(), allow_nan=False))
        assert {
            "verdict", "effects", "unknown", "untestable", "detection_limits", "gap", "rounds"
        } <= set(made)  # fmt: skip


def test_a_wrong_control_point_is_named_with_its_name_and_error():
    block = made()
    row = block.ground.index[block.ground["role"] == "control"][2]
    name = block.ground.loc[row, "point"]
    block.ground.loc[row, ["x", "y", "z"]] += [0.06, -0.04, 0.05]
    (found,) = diagnose(block).effects
    assert (found["slug"], found["point"]) == ("control_blunder", name)
    for parameter, true in zip(found["parameters"], (0.06, -0.04, 0.05), strict=True):
        assert abs(parameter["value"] - true) < 4 * parameter["sigma"]


@pytest.mark.slow
def test_gnss_bias_and_control_datum_are_never_told_apart():
    """They are one effect with two signs: no data of this kind can separate them."""
    block = made(gnss_bias={"x": 0.06, "y": -0.05, "z": 0.07})
    block.lever_arm_fixed = True
    result = diagnose(block)
    assert result.verdict == "ambiguous"
    both = {result.effects[0]["slug"], *result.effects[0]["cannot_be_told_apart_from"]}
    assert {"gnss_bias", "control_datum"} <= both
    # The adjustment goes on with one of them, and says with which.
    (used,) = result.used
    assert result.effects[0]["adjusted_with"] == used and used in both
    assert not result.after.effects.empty and set(result.after.effects["slug"]) == {used}
    assert result.effects[0]["class"] == "ambiguous"
    # Neither predicts tie points better than the other; check points tell: they know the datum.
    assert all(abs(share["tie"] - 1) < 0.01 for share in result.rivals.values())


@pytest.mark.slow
def test_check_points_choose_among_what_nothing_else_tells_apart():
    """Control 0.1 m off in a datum of its own, and check points not."""
    block = made()
    control = block.ground["role"] == "control"
    block.ground.loc[control, ["x", "y", "z"]] += [0.10, -0.06, 0.08]
    block.ground["group"] = np.where(control, "old base", "new base")
    block.lever_arm_fixed = True
    result = diagnose(block)
    assert result.verdict == "ambiguous"
    assert result.used == ["control_datum"]
    assert result.gap["check_m"]["after"] < 0.2 * result.gap["check_m"]["before"]


@pytest.mark.parametrize(
    ("columns", "slug"),
    [
        (["time_s"], "focal_drift"),
        (["temperature_c"], "thermal"),
        # With times, velocities are derived.
        (["vx", "time_s"], "rolling_shutter"),
    ],
)
def test_a_missing_column_is_listed_and_stops_nothing(columns, slug):
    block = made()
    block.images = block.images.drop(columns=columns)
    result = diagnose(block, only=[slug, "sensor_unflatness"])
    assert result.untestable == [{"slug": slug, "missing": f"images.{columns[0]}"}]


@pytest.mark.slow
def test_pictures_alone_are_diagnosed_too():
    block = made()
    block.images = block.images.drop(
        columns=["time_s", "temperature_c", "vx", "vy", "vz", "wx", "wy", "wz"], errors="ignore"
    )
    block.gnss, block.ground = block.gnss.iloc[:0], block.ground.iloc[:0]
    result = diagnose(block)
    assert result.verdict == "nothing"
    assert result.gap["check_m"] is None and result.gap["gnss_m"] is None


@pytest.mark.slow
def test_a_drift_that_steps_from_flight_to_flight_imitate_is_ambiguous():
    """Three flights in a row: what grows in time and what differs by flight fit alike."""
    block = corridor_block(
        images=36, strips=3, flights=3, observations_per_image=120, control=6, check=0, relief=6.0,
        seed=2, wind=2.0,
    )  # fmt: skip
    block = add(block, {"principal_point_drift": {"x_rate": 0.05, "y_rate": -0.03}})
    block = add_noise(block, tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.002, seed=2)
    block.sigma |= {"tie_px": 0.3, "mark_px": 0.3}
    effects = diagnose(block).effects
    assert effects
    for one in effects:
        known = {one["slug"], *one["cannot_be_told_apart_from"]}
        assert one["class"] != "named" or "principal_point_drift" in known


def test_believed_effects_are_no_candidates():
    block = made(rolling_shutter={"readout": 0.025})
    result = diagnose(block, effects=["rolling_shutter"])
    assert result.verdict == "nothing"
    assert "rolling_shutter" not in result.detection_limits


def test_laboratory_knowledge_does_what_a_short_flight_cannot():
    """A prior of 0.4 +- 0.02 px a degree names what was hidden; without heat it is refused."""
    block = made(thermal={"scale": 0.4})
    found = diagnose(block, priors={"thermal.scale": (0.4, 0.02)}, only=["thermal"])
    assert [one["slug"] for one in found.effects] == ["thermal"]


def test_a_refit_begins_where_the_first_adjustment_ended():
    """From start values half a metre off, its first step is a tenth of the cold one or less."""
    block = made()
    block.images[["x", "y", "z"]] += np.random.default_rng(1).normal(0, 0.5, (len(block.images), 3))
    believed = ReferenceModel.of(block, Model())
    believed.adjust()
    refit = believed.adjust([find("rolling_shutter")])
    start = corridor.adjust(block, camera="fraser10", effects=["rolling_shutter"])
    assert refit.history[0]["step"] < 0.1 * start.history[0]["step"]
    value, sigma = refit.effects.iloc[0][["value", "sigma"]]
    assert value == pytest.approx(start.effects.iloc[0]["value"], abs=sigma)


def test_what_comes_out_is_compared_with_what_the_block_states():
    """Not with where the first of two adjustments left it."""
    block = made()
    ((name, camera),) = block.cameras.items()
    block.cameras = {name: camera.with_values(f=1.3 * camera["f"])}
    stated = f"{1.3 * camera['f']:.0f} px"
    warned = [w for w in ReferenceModel.of(block, Model()).adjust().warnings if "focal" in w]
    assert len(warned) == 1 and f"block.toml states {stated}" in warned[0]


def test_an_unknown_slug_is_refused():
    with pytest.raises(InputError, match="jelly"):
        diagnose(made(), without=["jelly"])


def test_a_level_that_is_no_probability_is_refused():
    with pytest.raises(InputError, match="level"):
        diagnose(made(), level=1.5)


def without(block, what):
    """The block without GNSS, check points, control or marks."""
    if what == "gnss":
        block.gnss = block.gnss.iloc[:0]
    if what in ("check", "control"):
        block.ground = block.ground[block.ground["role"] != what].reset_index(drop=True)
    if what == "marks":
        block.marks, block.ground = block.marks.iloc[:0], block.ground.iloc[:0]
    return block


@pytest.mark.parametrize(
    ("what", "slug", "missing"),
    [
        ("gnss", "gnss_bias", "gnss.x"),
        ("control", "control_datum", "ground.role"),
        ("marks", "control_blunder", "ground.x"),
        ("check", None, None),
    ],
)
def test_a_missing_table_is_listed_and_stops_nothing(what, slug, missing):
    only = [*([slug] if slug else []), "rolling_shutter"]
    result = diagnose(without(made(), what), only=only)
    assert result.verdict == "nothing"
    assert result.untestable == ([{"slug": slug, "missing": missing}] if slug else [])
    assert (result.gap["check_m"] is None) == (what in ("check", "marks"))
    assert (result.gap["gnss_m"] is None) == (what == "gnss")
    json.dumps(result.to_dict(), allow_nan=False)
