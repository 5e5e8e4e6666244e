"""Every effect of the folder keeps the contract; nobody is excused."""

import ast
import inspect
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from rigged import rig_table, rigged_block
from strips import CAMLIGHT, corridor_block

import corridor
from corridor.core.camera import INTERIOR, undistort
from corridor.core.effects import add, every_effect, find, predict, take_out
from corridor.core.effects.context import GROUPS, Context, Images
from corridor.core.effects.contract import PLACES, Effect
from corridor.core.effects.forward import gather
from corridor.core.errors import InputError
from corridor.core.preparation import prepare
from corridor.core.simulation import add_noise

FOLDER = Path(inspect.getfile(Effect)).parent / "catalogue"
# Small enough that nothing hides in the noise, and that GNSS and control hold the block.
NOISE = {
    "tie_px": 0.05, "mark_px": 0.05, "gnss_m": 0.002, "control_m": 0.002, "attitude_deg": 0.002,
}  # fmt: skip


def flown(**options):
    """20 images in two flights that head opposite ways, with all that an effect may need."""
    block = corridor_block(
        images=20,
        strips=2,
        flights=2,
        camera=replace(CAMLIGHT, readout_s=0.030, calibrated=True),
        observations_per_image=220,
        relief=6.0,
        control=5,
        check=3,
        seed=4,
        **options,
    )
    # Cold, warm and cold again: temperature is not another word for time.
    block.images["temperature_c"] = 25 + 10 * np.sin(np.arange(20.0))
    # The plain lies at 0 m: half of the points are under water.
    block.extra["effect"] = {"water_refraction": {"level": 1.0}}
    # Measured by an IMU whose boresight is known: no effect comes with its attitudes.
    block.extra["attitudes"] = {"calibrated": True}
    block.attitudes = block.images[["image", "qw", "qx", "qy", "qz"]].copy()
    # Bars between neighbours of a list of points that many images show.
    rays = block.tie_points["point"].value_counts()
    names = sorted(rays.index[rays >= 4].astype(str))[:12]
    at = block.points.set_index("point").loc[names, ["x", "y", "z"]].to_numpy(float)
    length = np.linalg.norm(at[1:] - at[:-1], axis=1)
    block.distances = pd.DataFrame({"from": names[:-1], "to": names[1:], "distance": length})
    block.check()
    return block


@pytest.fixture(scope="module")
def drone():
    return flown()


@pytest.fixture(scope="module")
def with_gyroscope(drone):
    """The drone's strip with rates.csv: 2 degrees a second that change within a tenth of one."""
    block = drone.copy()
    time = block.images["time_s"].to_numpy()[:, None] + np.arange(-0.2, 0.2, 0.001)
    phase = np.random.default_rng(3).uniform(0, 2 * np.pi, (3, *block.images.shape[:1], 1))
    rate = 0.035 * np.sin(2 * np.pi * 2.0 * time + phase)
    block.rates = pd.DataFrame(
        {"time_s": time.ravel(), "image": np.repeat(block.images["image"], time.shape[1])}
        | dict(zip(("wx", "wy", "wz"), rate.reshape(3, -1), strict=True))
    ).reset_index(drop=True)
    block.check()
    return block


@pytest.fixture(scope="module")
def head():
    """A head of three cameras that warms up and cools down; how they hang is known exactly."""
    block = rigged_block(exposures=12, points=1500)
    rng = np.random.default_rng(7)
    count = len(block.images)
    time = block.images["time_s"].to_numpy()
    ahead = np.where(time < np.median(time), 1.0, -1.0)
    block.images[["vx", "vy", "vz"]] = np.stack([5.0 * ahead, 0.3 * ahead, 0.1 * ahead], axis=1)
    block.images[["wx", "wy", "wz"]] = 0.02 * rng.standard_normal((count, 3))
    block.images["temperature_c"] = 25 + 10 * np.sin(0.7 * time)
    block.images["strip"] = "1"
    block.extra["rig"] = rig_table(sigma_m=0.0, sigma_deg=0.0)
    block.extra["attitudes"] = {"calibrated": True}
    block.attitudes = block.images[["image", "qw", "qx", "qy", "qz"]].copy()
    block = block.with_()
    block.check()
    return block


@pytest.fixture(scope="module")
def aeroplane():
    return flown(height=3000.0, interval_s=8.0)


@pytest.fixture(scope="module")
def strips(drone, aeroplane, head):
    """The strip in which each effect shows, by slug."""
    still = predict(drone)
    loose = head.copy()
    loose.extra["rig"] = rig_table()
    return {
        effect.slug: (loose if effect.believed(loose) else head)
        if effect.needs[:1] == ("rig.member",)
        else chosen(effect, drone, still, aeroplane)
        for effect in every_effect()
    }


@pytest.fixture(scope="module")
def strip(effect, strips, with_gyroscope):
    return with_gyroscope if gyroscopic(effect) else strips[effect.slug]


@pytest.fixture(scope="module")
def truth(effect, strip):
    return drawn(effect, strip)


@pytest.fixture(scope="module")
def moved(effect, strip, truth):
    """The strip as the effect alone makes it: not to be changed."""
    return add(strip, {effect.slug: truth})


def gyroscopic(effect):
    return any(need.startswith("rates.") for need in effect.needs)


def every_form():
    """The catalogue, and those of it that are others where the block has a gyroscope."""
    recorded = SimpleNamespace(rates=[0.0], ground_groups=["base"])
    forms = [effect.form(recorded) for effect in every_effect()]
    return every_effect() + [effect for effect in forms if gyroscopic(effect)]


def chosen(effect, drone, here, aeroplane):
    """The drone's strip, and an aeroplane's for what 60 m of corridor at 50 m hardly show."""
    there = predict(drone, {effect.slug: drawn(effect, drone)})
    signal = sum(
        np.sum((vars(there)[kind] - vars(here)[kind]) ** 2) / NOISE[noise] ** 2
        for kind, noise in zip(("tie", "mark", "gnss", "control", "attitude"), NOISE, strict=True)
    )
    return drone if signal > 20**2 else aeroplane


def drawn(effect, block, seed=0):
    """Values (groups, parameters) of the size an effect states, different in every group."""
    rng = np.random.default_rng(seed)
    stack, start = gather(block, {effect.slug: {}})
    scale = [parameter.scale for parameter in stack.members[effect.slug].parameters]
    size = rng.uniform(0.7, 1.3, start[effect.slug].shape)
    return size * np.where(rng.random(size.shape) < 0.5, -1, 1) * scale


def context_of(effect, block):
    """What the effect looks at in the block, a row for each thing that it moves."""
    images = Images.of(block)
    if effect.place == "camera":
        return Context(images, np.arange(len(images.names)))
    if effect.place == "antenna":
        return Context(images, block.image_rows("gnss"))
    if effect.place == "attitude":
        return Context(images, block.image_rows("attitudes"))
    if effect.place == "ground":
        control = block.ground[block.ground["role"] == "control"]
        given = control[["x", "y", "z"]].to_numpy(float)
        return Context(images, point=list(control["point"]), position=given)
    if effect.place == "distance":
        rows = np.arange(len(block.distances))
        return Context(images, distance=rows, length=block.column("distances", "distance"))
    image, pixel = block.image_rows("tie_points")[::10], predict(block).tie[::10]
    if effect.place == "motion":
        axis, factor, offset = images.row_of[image].T
        along = np.where(axis == 1, pixel[:, 1], pixel[:, 0])
        return Context(images, image, row=factor * along + offset)
    ray = undistort(pixel, images.interior, image)
    point = block.positions("tie_points")[block.tie_points["point"].cat.codes.to_numpy()][::10]
    return Context(images, image, pixel=pixel, ray=ray, position=point)


def same_bits(a, b):
    """Whether two predictions are the same number for number."""
    return all(np.array_equal(vars(a)[k], vars(b)[k], equal_nan=True) for k in vars(a))


def without(block, column):
    """The block without one needed column."""
    out = block.copy()
    table, _, name = column.partition(".")
    if table == "effect":
        out.extra.pop("effect")
    elif table == "rig":
        out.extra.pop("rig")
    elif table == "camera":
        out.cameras = {k: replace(c, **{name: None}) for k, c in out.cameras.items()}
    else:
        setattr(out, table, getattr(out, table).drop(columns=name))
    return out


@pytest.mark.parametrize(
    "effect",
    every_form(),
    ids=lambda effect: effect.slug + "-by-gyroscope" * gyroscopic(effect),
    # What the tests of one effect share is made once.
    scope="module",
)
class TestEveryEffect:
    def test_derivative_agrees_with_central_differences(self, effect, strip, truth):
        context = context_of(effect, strip)
        values = truth[context.group(effect.group)]
        shift, derivative = effect.shift(context, values)
        assert shift.shape == (len(context), PLACES[effect.place])
        assert derivative.shape == (*shift.shape, values.shape[1])
        for k, parameter in enumerate(effect.parameters(strip)):
            step = np.zeros(values.shape[1])
            step[k] = 1e-3 * parameter.scale
            high, low = (effect.shift(context, values + s)[0] for s in (step, -step))
            numeric = (high - low) / (2 * step[k])
            largest = np.abs(derivative[:, :, k]).max()
            assert largest > 0, "a parameter that moves nothing"
            assert np.abs(derivative[:, :, k] - numeric).max() < 1e-6 * largest

    def test_zero_parameters_move_nothing_bit_for_bit(self, effect, strip, truth):
        context = context_of(effect, strip)
        zero, still = np.zeros_like(truth), predict(strip)
        shift, derivative = effect.shift(context, zero[context.group(effect.group)])
        assert not shift.any() and np.isfinite(derivative).all()
        assert same_bits(predict(strip, {effect.slug: zero}), still)
        assert not same_bits(predict(strip, {effect.slug: truth}), still)

    def test_what_is_simulated_is_estimated_within_its_sigma(self, effect, strip, truth, moved):
        """Camera and stated lever arm held, control and GNSS good to 2 mm, 0.05 px in the image.

        Within four sigmas, as the 600 values of the catalogue drawn at random are.
        """
        block = add_noise(moved, **NOISE, seed=11)
        found = corridor.adjust(block, camera="fixed", effects=[effect.slug], lever_arm="fixed")
        assert found.converged
        # All effects are linear in what they move to one per cent, so the noise is all there is.
        assert found.sigma0 == pytest.approx(1, abs=4 / np.sqrt(2 * found.redundancy))
        assert len(found.effects) == truth.size
        expected = true_rows(effect, strip, found, truth)
        off = (found.effects["value"] - expected) / found.effects["sigma"]
        assert np.abs(off).max() < 4
        # Significant, or being within the sigma would say nothing.
        assert np.sqrt(np.mean((expected / found.effects["sigma"]) ** 2)) > 5

    def test_a_perfect_block_gives_its_values_back(self, effect, strip, truth, moved):
        """To a hundredth of the sigma that noise would make; the adjustment stops at a thousandth.

        Start: poses and points where they would be without the effect.
        """
        block = moved.copy()
        block.sigma = add_noise(strip, **NOISE).sigma
        found = corridor.adjust(block, camera="fixed", effects=[effect.slug], lever_arm="fixed")
        assert found.converged
        off = found.effects["value"] - true_rows(effect, strip, found, truth)
        assert np.abs(off / found.effects["sigma"]).max() < 0.01 / found.sigma0
        assert found.sigma0 < 0.01

    def test_correcting_undoes_simulating(self, effect, strip, truth, moved):
        back = take_out(moved, {effect.slug: truth})
        assert not same_tables(moved, strip, 1e-6)
        assert same_tables(back, strip, 1e-9)

    def test_what_it_needs_is_named_when_it_is_missing(self, effect, strip):
        assert effect.missing(strip) == []
        for column in effect.needs:
            table, _, name = column.partition(".")
            file = "block.toml" if table in ("camera", "effect", "rig") else f"{table}.csv"
            block = without(strip, column)
            assert column in effect.missing(block)
            calls = [lambda block=block: predict(block, {effect.slug: {}})]
            # What a block can know by itself an adjustment fills in first.
            if effect.missing(prepare(block).block):
                calls.append(lambda block=block: corridor.adjust(block, effects=[effect.slug]))
            for call in calls:
                with pytest.raises(InputError) as error:
                    call()
                for word in (file, *name.split("."), effect.slug):
                    assert word in str(error.value)

    def test_nothing_is_looked_at_that_is_not_declared(self, effect, strip):
        """All optional columns that are not among its needs are dropped: it still works."""
        block = strip.copy()
        optional = "time_s temperature_c vx vy vz wx wy wz strip".split()
        spare = [name for name in optional if f"images.{name}" not in effect.needs]
        block.images = block.images.drop(columns=spare)
        block.cameras = {
            name: replace(c, pixel_um=None, readout_s=None)
            for name, c in block.cameras.items()
            if not any(need.startswith("camera.") for need in effect.needs)
        } or block.cameras
        assert not same_bits(predict(block, {effect.slug: drawn(effect, block)}), predict(block))

    def test_unit_scale_and_start_are_stated(self, effect, strip):
        parameters = effect.parameters(strip)
        assert parameters
        assert len({parameter.name for parameter in parameters}) == len(parameters)
        for parameter in parameters:
            assert parameter.name.isidentifier()
            assert parameter.unit
            assert np.isfinite(parameter.scale) and parameter.scale > 0
            assert np.isfinite(parameter.start)

    def test_it_says_what_it_is_and_where_it_acts(self, effect):
        assert effect.title and effect.title == effect.title.strip()
        assert effect.called[0].islower() and not effect.called.endswith(".")
        assert effect.place in PLACES
        assert effect.group in GROUPS
        assert (effect.group == "point") <= (effect.place == "ground")
        for need in effect.needs:
            table, _, column = need.partition(".")
            tables = (
                "images",
                "gnss",
                "attitudes",
                "rig",
                "rates",
                "track",
                "ground",
                "camera",
                "effect",
                "distances",
            )
            assert table in tables and column
        assert find(effect.slug).slug == effect.slug
        assert set(effect.stands_in_for) <= set(INTERIOR)

    def test_it_says_what_data_reveal_it_and_which_hide_it(self, effect):
        for text in (effect.revealed_by, effect.unobservable_when):
            assert len(text.split()) > 3 and not text.endswith(".")

    def test_the_file_bears_its_name_and_names_its_source(self, effect):
        module = inspect.getmodule(type(effect))
        assert Path(module.__file__) == FOLDER / f"{type(effect).slug}.py"
        assert "Source:" in effect.described()[0]


def true_rows(effect, block, found, truth):
    """The true values in the rows of the adjustment's table of effects."""
    stack, _ = gather(block, {effect.slug: {}})
    member = stack.members[effect.slug]
    names = [parameter.name for parameter in member.parameters]
    groups = [member.groups.index(group) for group in found.effects["group"]]
    return truth[groups, [names.index(name) for name in found.effects["parameter"]]]


def same_tables(a, b, tolerance):
    """Whether all measurements of two blocks agree, px and m."""
    for table, columns in (
        ("tie_points", ["x", "y"]),
        ("marks", ["x", "y"]),
        ("gnss", ["x", "y", "z"]),
        ("ground", ["x", "y", "z"]),
        ("attitudes", ["qw", "qx", "qy", "qz"]),
        ("distances", ["distance"]),
    ):
        one, other = (getattr(block, table)[columns].to_numpy(float) for block in (a, b))
        if np.abs(one - other).max(initial=0.0) > tolerance:
            return False
    return True


def test_every_file_holds_exactly_one_effect_and_the_catalogue_has_them_all():
    files = {path.stem for path in FOLDER.glob("*.py")} - {"__init__"}
    assert files == {type(effect).slug for effect in every_effect()}
    for name in files:
        module = import_module(f"corridor.core.effects.catalogue.{name}")
        own = [
            value
            for value in vars(module).values()
            if inspect.isclass(value)
            and issubclass(value, Effect)
            and value.__module__ == module.__name__
        ]
        assert len(own) == 1


def test_nothing_else_in_the_package_knows_an_effect_by_name():
    """Design, section 1: adding an effect is adding a file."""
    # `lever_arm` is a quantity of its own as well: block.toml states it, adjustments estimate it;
    # `thermal` is a verb of the command, `focal` a key of OpenSfM's files.
    slugs = {effect.slug for effect in every_effect()} - {"lever_arm", "thermal", "focal"}
    for path in FOLDER.parents[1].rglob("*.py"):
        # A room may bear the name of what it is about.
        if path == FOLDER.parents[1] / "__init__.py" or path.parent == FOLDER:
            continue
        text = path.read_text(encoding="utf-8")
        if not any(slug in text for slug in slugs):
            continue
        strings = {
            node.value
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
        assert not strings & slugs, f"{path.name} knows {strings & slugs}"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("rolling_shuter", "did you mean rolling_shutter"),
        ("", "rolling_shutter"),
        ("lever_arm ", "did you mean lever_arm"),
    ],
)
def test_an_unknown_effect_is_refused_with_the_nearest_or_the_list(name, words):
    with pytest.raises(InputError, match=f"is unknown.*{words}"):
        find(name)


def test_an_unknown_group_parameter_or_member_is_refused(drone):
    with pytest.raises(InputError, match="group 'week' is unknown"):
        find("lever_arm@week")
    with pytest.raises(InputError, match="rolling_shutter has no parameter 'speed'"):
        predict(drone, {"rolling_shutter": {"speed": 1.0}})
    with pytest.raises(InputError, match="lever_arm has no flight 'F9': it has F1, F2"):
        predict(drone, {"lever_arm@flight": {"x": {"F9": 1.0}}})
    with pytest.raises(
        InputError, match="control_blunder acts on ground points and has no group f"
    ):
        predict(drone, {"control_blunder@flight": {}})
    with pytest.raises(InputError, match="lever_arm acts on images and has no group point"):
        corridor.adjust(drone, effects=["lever_arm@point"])
    with pytest.raises(InputError, match="given twice"):
        corridor.adjust(drone, effects=["gnss_bias", "gnss_bias@flight"])


def test_an_image_that_lacks_what_the_effect_needs_is_named(drone):
    block = drone.copy()
    name = block.images["image"].iloc[7]
    block.images.loc[7, "time_s"] = np.nan
    with pytest.raises(InputError, match=f"images.csv: image {name} lacks .*images.time_s"):
        corridor.adjust(block, camera="fixed", effects=["focal_drift"])


def test_without_angular_rates_a_rolling_shutter_only_translates(drone):
    block = drone.copy()
    block.images[["wx", "wy", "wz"]] = 0.0
    still = predict(block, {"rolling_shutter": {"readout": 0.03}})
    block.images = block.images.drop(columns=["wx", "wy", "wz"])
    assert same_bits(still, predict(block, {"rolling_shutter": {"readout": 0.03}}))


def test_one_set_of_values_a_flight_is_simulated_and_estimated(drone):
    """`slug@flight`: the flights of one camera need not share a readout time."""
    truth = {"F1": 0.020, "F2": 0.035}
    slug = "rolling_shutter@flight"
    block = add_noise(add(drone, {slug: {"readout": truth}}), **NOISE, seed=2)
    found = corridor.adjust(block, camera="fixed", effects=[slug], lever_arm="fixed")
    table = found.effects.set_index("group")
    assert table.index.tolist() == ["F1", "F2"]
    off = (table["value"] - pd.Series(truth)) / table["sigma"]
    assert np.abs(off).max() < 4
    assert table["sigma"].max() < 0.1 * 0.015
    # One value for both is the block's readout, between the two and with worse residuals.
    shared = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"], lever_arm="fixed")
    assert 0.020 < shared.effects["value"].iloc[0] < 0.035
    assert shared.sigma0 > 1.2 * found.sigma0
