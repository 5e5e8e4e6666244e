"""The generator of hidden effects, against hand calculations and against the package's adjustment.

Two codes that share no line agree on what a flight measures; each effect does what its physics
says; a twin differs from its block by the effect alone.
"""

import ast
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import corridor
from benchmarks.diagnosis import generator
from benchmarks.diagnosis.generator import (
    CALM,
    CATALOGUE,
    NULLS,
    OUTSIDE,
    Case,
    null,
    perfect,
    single,
    together,
)
from benchmarks.diagnosis.generator.camera import FAMILIES, calibration, make_lens
from benchmarks.diagnosis.generator.generate import generate, main, make_scene, streams
from benchmarks.diagnosis.generator.ground import STRIPS
from benchmarks.diagnosis.generator.noise import NOISES, of_gnss, of_ties
from benchmarks.diagnosis.generator.physics import EFFECTS
from benchmarks.diagnosis.generator.trajectory import vector
from benchmarks.diagnosis.generator.unknown import UNKNOWN
from benchmarks.diagnosis.generator.world import bent_by_air

SMALL = {"images": 20, "observations": 60, "check": 4}
NUMBERS = ["x", "y", "z"]


def mostly_slow(every, quick):
    """Parameters, those that are not in `quick` marked slow."""
    return [p if p in quick else pytest.param(p, marks=pytest.mark.slow) for p in every]


# One of every place: shutter, camera, picture, antenna, clock, ground, and the unknown.
SLUGS = mostly_slow(
    [*CATALOGUE, *OUTSIDE],
    (
        "rolling_shutter",
        "focal",
        "thermal",
        "lever_arm",
        "time_rounding",
        "control_blunder",
        "jello",
    ),
)


def small(slug, **changes):
    """A case of one effect, small, with enough control for it."""
    return single(slug, **(SMALL | {"control": 7} | changes))


def places(table, key):
    return table.set_index(key)[NUMBERS].to_numpy(float)


def true_rotation(hidden):
    """World to camera, of the truth."""
    return Rotation.from_quat(
        np.array(list(hidden.truth["quaternion"].values())), scalar_first=True
    )


def parameters(hidden, slug):
    """Name -> value of the first entry of a slug."""
    entry = next(e for e in hidden.truth["effects"] if e["slug"] == slug)
    return {p["name"]: p["value"] for p in entry["parameters"]}


def moved(hidden, table="tie_points", columns=("x", "y")):
    """Block minus twin."""
    columns = list(columns)
    return (
        getattr(hidden.block, table)[columns].to_numpy()
        - getattr(hidden.twin, table)[columns].to_numpy()
    )


class TestIndependence:
    def test_the_generator_uses_the_packages_tables_and_nothing_else(self):
        used = set()
        for file in Path(generator.__file__).parent.glob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    used |= {name.name for name in node.names if "corridor" in name.name}
                elif isinstance(node, ast.ImportFrom) and "corridor" in (node.module or ""):
                    used |= {f"{node.module}.{name.name}" for name in node.names}
        assert used == {"corridor.Block", "corridor.Camera"}

    @pytest.mark.parametrize("geometry", STRIPS)
    def test_without_effect_and_noise_the_package_finds_the_ground_to_100_nm(self, geometry):
        """Start values miss by 0.3 m and 0.3 degrees, f by 4 px, the distortion altogether."""
        options = SMALL | {"images": 40 if geometry == "multi_height" else 30}
        hidden = generate(perfect(Case(geometry=geometry, family="fraser", **options)), 4)
        found = corridor.adjust(hidden.block, camera="fraser10")
        assert found.check_rms.d3 < 1e-7
        camera = found.block.cameras["cam"]
        for name, value in hidden.truth["camera"].items():
            assert camera[name] == pytest.approx(value, abs=1e-6)
        arm = found.lever_arm[NUMBERS].to_numpy()
        assert arm == pytest.approx(np.array(list(hidden.truth["lever_arm"].values())), abs=1e-6)

    def test_each_flight_has_its_own_lever_arm(self):
        case = perfect(Case(flights=3, strips=3, family="fraser", **SMALL | {"images": 30}))
        hidden = generate(case, 4)
        arms = np.array(list(hidden.truth["lever_arm"].values()))
        assert len(np.unique(arms, axis=0)) == 3
        found = corridor.adjust(hidden.block, camera="fraser10")
        assert found.lever_arm[NUMBERS].to_numpy() == pytest.approx(arms, abs=1e-6)

    @pytest.mark.parametrize("direction", ["down", "up", "right", "left"])
    def test_the_package_finds_the_readout_to_a_microsecond(self, direction):
        case = small("rolling_shutter", family="fraser", row_direction=direction, air=CALM)
        found = corridor.adjust(
            generate(perfect(case), 4).block, camera="fraser10", effects=["rolling_shutter"]
        )
        assert found.effects["value"].item() == pytest.approx(0.025, abs=1e-6)
        assert found.check_rms.d3 < 1e-6

    def test_in_wind_the_readout_is_found_to_a_third_of_a_per_cent(self):
        """The drone is pushed within the readout too: f a readout^2 / 8 h is 0.002 px for
        a = 0.2 m/s^2, and 0.02 px for the camera's angular acceleration of 0.4 deg/s^2."""
        case = small("rolling_shutter", family="fraser", images=40)
        found = corridor.adjust(
            generate(perfect(case), 4).block, camera="fraser10", effects=["rolling_shutter"]
        )
        assert found.effects["value"].item() == pytest.approx(0.025, rel=0.003)

    @pytest.mark.parametrize("slug", ["lever_arm", "gnss_bias", "clock_offset", "focal_drift"])
    def test_what_is_hidden_is_found_with_its_sign_and_unit(self, slug):
        """Exact but for the clock: half the acceleration times the offset squared."""
        case = small(slug, family="fraser", arms="fixed", images=40, geometry="oblique")
        hidden = generate(perfect(case), 4)
        found = corridor.adjust(hidden.block, camera="fraser10", effects=[slug])
        values = found.effects.groupby("parameter")["value"].first()
        for name, value in parameters(hidden, slug).items():
            assert values[name] == pytest.approx(
                value, abs=2e-5 if slug == "clock_offset" else 1e-9
            )
        assert found.check_rms.d3 < 1e-5


class TestTwin:
    @pytest.mark.parametrize("slug", SLUGS)
    def test_block_and_twin_share_every_error_of_measurement(self, slug):
        case = small(slug)
        with_noise, without = generate(case, 9), generate(perfect(case), 9)
        for table, columns in (
            ("tie_points", ["x", "y"]), ("marks", ["x", "y"]), ("gnss", NUMBERS),
            ("ground", NUMBERS), ("points", NUMBERS),
        ):  # fmt: skip
            noisy, clean = (moved(h, table, columns) for h in (with_noise, without))
            # Coordinates of 5,000 px are rounded at 1e-12.
            assert noisy == pytest.approx(clean, abs=1e-11)
        assert max(with_noise.truth["moved"].values()) > 0
        start = ["x", "y", "z", "qw", "qx", "qy", "qz", "temperature_c"]
        pd.testing.assert_frame_equal(with_noise.block.images[start], with_noise.twin.images[start])
        assert (
            with_noise.block.cameras["cam"].to_table() == with_noise.twin.cameras["cam"].to_table()
        )

    @pytest.mark.parametrize("kind", NULLS)
    def test_where_nothing_is_hidden_they_are_the_same(self, kind):
        hidden = generate(null(kind, **SMALL), 2)
        assert hidden.truth["effects"] == []
        assert set(hidden.truth["moved"].values()) == {0.0}
        for table in ("images", "tie_points", "marks", "gnss", "ground", "points"):
            assert getattr(hidden.block, table).equals(getattr(hidden.twin, table)), table

    @pytest.mark.parametrize("slug", ["lever_arm", "gnss_drift", "control_blunder"])
    def test_what_an_effect_does_not_touch_stays_bit_for_bit(self, slug):
        hidden = generate(small(slug), 2)
        assert not moved(hidden).any() and not moved(hidden, "marks").any()

    def test_two_effects_together_are_the_two_alone(self):
        case = perfect(together("thermal", "gnss_bias", **SMALL))
        both = generate(case, 3)
        heat, bias = (
            generate(replace(case, effects={slug: case.effects[slug]}), 3)
            for slug in ("thermal", "gnss_bias")
        )
        assert moved(both) == pytest.approx(moved(heat), abs=1e-11)
        assert moved(both, "gnss", NUMBERS) == pytest.approx(
            moved(bias, "gnss", NUMBERS), abs=1e-12
        )

    def test_the_seed_decides_everything(self):
        case = single("jello", gnss="interpolated", gaps=1, gyro="rates", **SMALL)
        one, again, other = (generate(case, seed) for seed in (1, 1, 2))
        assert one.truth == again.truth != other.truth
        for table in (
            "images",
            "tie_points",
            "points",
            "marks",
            "ground",
            "gnss",
            "track",
            "rates",
        ):
            assert getattr(one.block, table).equals(getattr(again.block, table)), table
        assert not one.block.images["x"].equals(other.block.images["x"])


class TestFolder:
    @pytest.mark.parametrize("gnss", ["exposures", "interpolated", "track", "none"])
    @pytest.mark.parametrize("slug", mostly_slow(["lever_arm", "rolling_shutter"], ["lever_arm"]))
    def test_a_block_is_read_as_it_was_made(self, gnss, slug, tmp_path):
        hidden = generate(small(slug, gnss=gnss, gyro="rates", flights=2), 6)
        folder = hidden.write(tmp_path / "one")
        read = corridor.read(folder)
        for table in (
            "images",
            "tie_points",
            "points",
            "marks",
            "ground",
            "gnss",
            "track",
            "rates",
        ):
            made = getattr(hidden.block, table)
            pd.testing.assert_frame_equal(getattr(read, table)[list(made)], made)
        assert (len(read.gnss) > 0) == (gnss in ("exposures", "interpolated"))
        assert (len(read.track) > 0) == (gnss in ("interpolated", "track"))
        assert read.lever_arm == hidden.block.lever_arm
        assert corridor.read(tmp_path / "one_twin").name == read.name

    @pytest.mark.parametrize("slug", SLUGS)
    def test_the_truth_is_never_in_the_block(self, slug, tmp_path):
        """Neither the effect's name nor its numbers; and start values miss the true ones."""
        hidden = generate(small(slug), 6)
        folder = hidden.write(tmp_path / "one")
        text = "".join(file.read_text(encoding="utf-8") for file in folder.iterdir())
        for entry in hidden.truth["effects"]:
            # block.toml has a table of this name in any case.
            assert entry["slug"] == "lever_arm" or entry["slug"] not in text
            for parameter in entry["parameters"]:
                value = repr(parameter["value"])
                # Short ones (0.025) may be there by chance.
                assert len(value) < 10 or value not in text
        for table, truth, key in (("images", "centre", "image"), ("points", "points", "point")):
            true = np.array(list(hidden.truth[truth].values()))
            wrong = np.linalg.norm(places(getattr(hidden.block, table), key) - true, axis=1)
            assert wrong.min() > 0.005 and 0.3 < wrong.mean() < 0.7

    def test_the_command_writes_block_twin_and_truth(self, tmp_path, capsys):
        main(["focal", "3", str(tmp_path / "f"), "--images", "20", "--factor", "2"])
        assert sorted(p.name for p in tmp_path.iterdir()) == ["f", "f.truth.json", "f_twin"]
        assert "wrote" in capsys.readouterr().out
        assert corridor.read(tmp_path / "f").cameras["cam"].calibrated


class TestFlight:
    @pytest.mark.parametrize("geometry", STRIPS)
    @pytest.mark.parametrize("flights", mostly_slow([1, 2, 3], [2]))
    def test_every_geometry_can_be_flown(self, geometry, flights):
        case = Case(geometry=geometry, flights=flights, sortie="all", **SMALL | {"images": 36})
        block = generate(case, 1).block
        block.check()
        assert len(block.flight_names) == flights
        seen = block.tie_points.groupby("image", observed=False).size()
        assert seen.min() > 15 and 45 < seen.mean() < 75
        rays = block.tie_points.groupby("point", observed=True).size()
        assert rays.min() >= 2 and rays.mean() > 2.5
        assert block.marks["point"].nunique() == len(block.ground)

    def test_velocity_and_rate_are_those_of_the_poses(self):
        """Against differences of the trajectory's own poses: 1e-6 of m/s and rad/s."""
        flight = make_scene(Case(**SMALL), streams(5)).trajectory
        at, step = flight.exposure, 1e-4
        slope = (flight.centre(at + step) - flight.centre(at - step)) / (2 * step)
        assert flight.velocity(at) == pytest.approx(slope, abs=1e-6)
        # World to camera turns against the camera: R(t + s) = Exp(-w s) R(t).
        turn = flight.rotation(at + step) @ flight.rotation(at).transpose(0, 2, 1)
        assert flight.rate(at + step / 2) == pytest.approx(-vector(turn) / step, abs=1e-6)

    def test_a_flight_starts_from_rest_and_the_next_after_a_pause(self):
        track = generate(perfect(Case(flights=2, gnss="track", **SMALL)), 3).block.track
        for _, flight in track.groupby("flight"):
            at_rest = flight[NUMBERS].to_numpy()[:8]
            assert np.ptp(at_rest, axis=0) == pytest.approx(0, abs=1e-3)
            speed = np.linalg.norm(np.diff(flight[NUMBERS], axis=0), axis=1)
            assert speed.max() > 4
        assert np.diff(track["time_s"]).max() > 300

    def test_the_camera_turns_with_the_strip_or_keeps_its_yaw(self):
        for geometry, share in (("nadir", 0.5), ("fixed_yaw", 0.0)):
            hidden = generate(Case(geometry=geometry, **SMALL), 3)
            up = -true_rotation(hidden).as_matrix()[:, 1]  # the picture's top in the world
            assert np.mean(up @ up[0] < 0) == pytest.approx(share)

    def test_strips_differ_in_ground_speed_as_the_wind_blows(self):
        images = generate(Case(**SMALL | {"images": 40}), 3).block.images
        speed = np.hypot(images["vx"], images["vy"]).groupby(images["strip"]).mean()
        assert 0.5 < abs(speed["S1"] - speed["S2"]) < 2.0

    def test_the_thermometer_is_late_and_rounded(self):
        hidden = generate(single("thermal", **SMALL | {"images": 80}), 3)
        read = hidden.block.images["temperature_c"].to_numpy()
        heat = np.array(list(hidden.truth["heat_c"].values()))
        assert read / 0.3 == pytest.approx(np.round(read / 0.3), abs=1e-6)
        assert np.diff(heat).min() > 0
        # 25 s of the first-order lag, once it has settled: dT/dt is (15 - T) / 400 s.
        slow = 25.0 * (18.0 + 15.0 - heat) / 400.0
        assert np.mean(heat - read) == pytest.approx(np.mean(slow), abs=0.15)


class TestLens:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_fraser_takes_nearly_all_of_a_lens_that_is_not_his(self, family):
        """0.003 px of the family itself, and the texture; a corner is bent by 20 px."""
        for seed in range(5):
            smooth, rough = (
                make_lens(family, 5120, 3840, 5500.0, texture, np.random.default_rng(seed))
                for texture in (0.0, 0.03)
            )
            assert calibration(smooth)[1] < 0.003 < calibration(rough)[1] < 0.045
            corner = np.array([0.45]), np.array([0.34])
            assert np.hypot(*np.subtract(smooth.bend(*corner), corner)).item() * smooth.f > 20

    def test_a_division_lens_is_undone_by_its_own_law(self):
        """r = r' / (1 + s r'^2), by the definition."""
        s, r = -0.05, np.array([0.1, 0.4])
        bent, _ = FAMILIES["division"](r, 0 * r, (0.0, 0.0), (s,))
        assert bent / (1 + s * bent**2) == pytest.approx(r, abs=1e-15)


class TestEffectsByHand:
    def test_all_of_the_issues_slugs_are_there(self):
        assert set(CATALOGUE) == set(EFFECTS) and set(OUTSIDE) == set(UNKNOWN)
        assert len(CATALOGUE) == 23

    def test_a_rolling_shutter_of_25_ms_at_6_m_s_moves_the_last_row_by_8_px(self):
        """6 m/s times 12.5 ms are 75 mm, f 75 mm / 50 m = 8.25 px, along the flight."""
        case = perfect(small("rolling_shutter", family="fraser", air=replace(CALM, head=0.0)))
        hidden = generate(case, 2)
        row = hidden.twin.tie_points["y"] / (3840 - 1) - 0.5
        # The ground is up to 5 m nearer than 50 m, the bank's crest.
        expected = row * 0.025 * 6.0 * 5500 / 50
        # The lens bends a shift along y a little towards x.
        assert moved(hidden)[:, 0] == pytest.approx(0 * row, abs=0.1)
        ratio = moved(hidden)[:, 1] / expected
        assert ratio[np.abs(row) > 0.1].between(0.97, 1.15).all()

    def test_a_longer_focal_length_moves_points_away_from_the_principal_point(self):
        hidden = generate(perfect(small("focal", family="fraser")), 2)
        camera = hidden.truth["camera"]
        away = hidden.twin.tie_points[["x", "y"]].to_numpy() - [camera["cx"], camera["cy"]]
        assert moved(hidden) == pytest.approx(away * 6.0 / camera["f"], abs=1e-9)

    def test_focal_drift_counts_from_the_middle_of_the_times(self):
        hidden = generate(perfect(small("focal_drift", family="fraser")), 2)
        camera, images = hidden.truth["camera"], hidden.block.images
        middle = (images["time_s"].min() + images["time_s"].max()) / 2
        gain = (images["time_s"] - middle).to_numpy() * parameters(hidden, "focal_drift")["rate"]
        gain = gain[hidden.block.image_rows("tie_points")]
        away = hidden.twin.tie_points[["x", "y"]].to_numpy() - [camera["cx"], camera["cy"]]
        assert moved(hidden) == pytest.approx(away * gain[:, None] / camera["f"], abs=1e-9)

    def test_heat_moves_the_edge_by_scale_times_degrees(self):
        """About the picture's middle; to 0.02 px, as cubic and shift are switched off."""
        options = {"amplitude": 0.4, "shares": (1.0, 0.0, 0.0, 0.0)}
        hidden = generate(perfect(Case({"thermal": options}, **SMALL)), 2)
        heat = np.array(list(hidden.truth["heat_c"].values()))
        warmer = (heat - (heat.min() + heat.max()) / 2)[hidden.block.image_rows("tie_points")]
        away = hidden.twin.tie_points[["x", "y"]].to_numpy() - [2559.5, 1919.5]
        expected = 0.4 * warmer[:, None] * away / 2559.5
        assert moved(hidden) == pytest.approx(expected, abs=1e-3)

    @pytest.mark.parametrize(
        "slug, edge", [("radial_distortion", 2.0), ("decentring_distortion", 1.0),
                       ("affine_distortion", 3.0)]
    )  # fmt: skip
    def test_distortion_moves_the_end_of_the_long_side_by_the_amplitude(self, slug, edge):
        """At the end of the long side: k1 u^3 f; 3 p1 u^2 f along the offset; b1 u f."""
        hidden = generate(perfect(small(slug)), 2)
        u = 2559.5 / hidden.truth["camera"]["f"]
        f, values = hidden.truth["camera"]["f"], parameters(hidden, slug)
        size = np.hypot(*list(values.values())[:2])
        power = {"radial_distortion": 3, "decentring_distortion": 2, "affine_distortion": 1}[slug]
        factor = 3 if slug == "decentring_distortion" else 1
        assert factor * f * size * u**power == pytest.approx(edge, rel=0.01)
        assert 0.6 * edge < np.abs(moved(hidden)).max() < 2.2 * edge

    def test_an_unflat_sensor_is_described_by_its_legendre_coefficients(self):
        hidden = generate(perfect(small("sensor_unflatness")), 2)
        values = parameters(hidden, "sensor_unflatness")
        x, y = hidden.twin.tie_points[["x", "y"]].to_numpy().T
        grid = [2 * x / 5119 - 1, 2 * y / 3839 - 1]
        for axis, name in enumerate("xy"):
            series = sum(
                values[f"{name}_{i}{j}"]
                * np.polynomial.legendre.legval(grid[0], np.eye(5)[i])
                * np.polynomial.legendre.legval(grid[1], np.eye(5)[j])
                for i in range(5) for j in range(5 - i)
            )  # fmt: skip
            assert moved(hidden)[:, axis] == pytest.approx(series, abs=0.01)
        assert values["rms"] == 0.5
        # Shift, scale and shear are what a camera is calibrated with.
        low = [values[f"{axis}_{term}"] for axis in "xy" for term in ("00", "10", "01")]
        assert low == pytest.approx([0.0] * 6, abs=1e-9)

    def test_a_lever_arm_turns_with_the_camera(self):
        hidden = generate(perfect(small("lever_arm")), 2)
        arm = list(parameters(hidden, "lever_arm").values())
        expected = true_rotation(hidden).inv().apply(arm)
        assert moved(hidden, "gnss", NUMBERS) == pytest.approx(expected, abs=1e-9)
        assert np.linalg.norm(arm) == pytest.approx(0.06)
        stated = hidden.block.lever_arm["default"]
        assert hidden.block.lever_arm_fixed and hidden.truth["lever_arm"]["F1"] == pytest.approx(
            np.add(stated, arm), abs=1e-8
        )

    def test_a_camera_delay_of_17_ms_at_6_m_s_is_10_cm(self):
        """True time is later than stated, so that the antenna was taken too far back."""
        case = Case({"clock_offset": 0.017}, geometry="fixed_yaw", air=CALM, **SMALL)
        hidden = generate(perfect(case), 2)
        images = hidden.block.images
        ahead = images[["vx", "vy", "vz"]].to_numpy()
        speed = np.linalg.norm(ahead, axis=1)
        back = np.einsum("ni,ni->n", moved(hidden, "gnss", NUMBERS), -ahead) / speed
        assert back == pytest.approx(0.017 * speed, abs=1e-6)
        assert back.mean() == pytest.approx(0.102, abs=0.001)
        late = (hidden.twin.images["time_s"] - images["time_s"]).to_numpy()
        assert late == pytest.approx(0.017, abs=1e-8)

    def test_times_in_steps_of_a_tenth_are_off_by_29_ms(self):
        hidden = generate(small("time_rounding", images=80), 2)
        step = 0.03 * np.sqrt(12)
        ticks = hidden.block.images["time_s"].to_numpy() / step
        assert ticks == pytest.approx(np.round(ticks), abs=1e-6)
        late = np.array(list(hidden.truth["effects"][0]["per_image"]["offset"].values()))
        assert late == pytest.approx(
            (hidden.twin.images["time_s"] - hidden.block.images["time_s"]).to_numpy(), abs=1e-8
        )
        assert np.std(late) == pytest.approx(0.03, rel=0.2)

    def test_bias_drift_and_scale_of_the_antenna(self):
        bias, drift, scale = (
            generate(small(slug), 2) for slug in ("gnss_bias", "gnss_drift", "gnss_scale")
        )
        expected = list(parameters(bias, "gnss_bias").values())
        assert moved(bias, "gnss", NUMBERS) == pytest.approx(np.tile(expected, (20, 1)), abs=1e-12)
        rate = np.array(list(parameters(drift, "gnss_drift").values()))
        time_s = drift.block.images["time_s"].to_numpy()
        since = time_s - (time_s.min() + time_s.max()) / 2
        assert moved(drift, "gnss", NUMBERS) == pytest.approx(since[:, None] * rate, abs=1e-9)
        # 400 ppm of the distance between the first and the last antenna, in plan.
        plan = scale.twin.gnss[["x", "y"]].to_numpy()
        gain = np.ptp(moved(scale, "gnss", ["x", "y"]), axis=0)
        assert gain == pytest.approx(400e-6 * np.ptp(plan, axis=0), rel=0.01)
        assert not moved(scale, "gnss", ["z"]).any()

    def test_the_receivers_epochs_are_wrong_as_its_exposures_are(self):
        hidden = generate(small("gnss_bias", gnss="interpolated"), 2)
        expected = list(parameters(hidden, "gnss_bias").values())
        for table in ("track", "gnss"):
            found = moved(hidden, table, NUMBERS)
            assert found == pytest.approx(np.tile(expected, (len(found), 1)), abs=1e-10)

    def test_a_blunder_is_of_one_control_point_and_a_datum_of_all(self):
        one, every = (generate(small(slug), 2) for slug in ("control_blunder", "control_datum"))
        shift = moved(one, "ground", NUMBERS)
        hit = np.flatnonzero(shift.any(axis=1))
        assert one.block.ground["point"][hit].tolist() == [one.truth["effects"][0]["point"]]
        assert shift[hit[0]] == pytest.approx(list(parameters(one, "control_blunder").values()))
        control = (every.block.ground["role"] == "control").to_numpy()
        shift = moved(every, "ground", NUMBERS)
        assert np.ptp(shift[control], axis=0) == pytest.approx(0, abs=1e-12)
        assert not shift[~control].any()

    def test_the_earth_falls_away_by_28_mm_at_600_m(self):
        """600^2 / 2 R; heights of control points rise."""
        hidden = generate(small("earth_curvature", images=80), 2)
        middle = np.mean(list(hidden.truth["centre"].values()), axis=0)
        ground = np.array(list(hidden.truth["ground"].values()))
        away = np.hypot(*(ground - middle)[:, :2].T) / 600
        control = (hidden.block.ground["role"] == "control").to_numpy()
        expected = 80 * 0.02825 * away**2 * control
        assert moved(hidden, "ground", ["z"])[:, 0] == pytest.approx(expected, abs=2e-4)

    def test_refraction_agrees_with_the_textbooks_to_a_tenth(self):
        """Wolf and Dewitt: K = 7.4e-4 (H - h)(1 - 0.02 (2 H - h)) degrees at H = 3, h = 0 km,
        outwards; their atmosphere differs from an exponential one by some per cent."""
        angle = np.radians(30.0)
        ray = np.array([[3000 * np.tan(angle), 0.0, -3000.0]])
        bent = bent_by_air(ray, np.zeros(1), np.full(1, 3000.0), 1.0)
        gain = np.arctan2(bent[0, 0], -bent[0, 2]) - angle
        textbook = np.radians(7.4e-4 * 3 * (1 - 0.02 * 6)) * np.tan(angle)
        assert gain == pytest.approx(textbook, rel=0.1)


class TestOutsideTheCatalogue:
    def test_a_bump_is_local(self):
        hidden = generate(perfect(small("local_bump", observations=300)), 2)
        x0, y0, x1, y1 = hidden.truth["effects"][0]["where"]["image"]
        place, shift = hidden.twin.tie_points, np.hypot(*moved(hidden).T)
        inside = place["x"].between(x0, x1) & place["y"].between(y0, y1)
        assert shift.max() == pytest.approx(1.5, abs=0.02)
        # At two radii the bump has 2 exp(1/2 - 2) of its largest shift left.
        assert shift[~inside].max() < 0.446 * 1.5

    def test_a_window_covers_one_side_with_a_sharp_rim(self):
        hidden = generate(perfect(small("window", observations=300)), 2)
        x0, _, x1, _ = hidden.truth["effects"][0]["where"]["image"]
        inside = hidden.twin.tie_points["x"].between(x0, x1).to_numpy()
        shift = moved(hidden)
        assert not shift[~inside].any() and not shift[:, 1].any()
        assert np.abs(shift[inside, 0]).mean() == pytest.approx(2.0, rel=0.1)

    def test_jello_shakes_by_f_times_the_angle(self):
        """2e-4 rad times 5,500 px are 1.1 px in the middle, a third more at the corners."""
        shift = moved(generate(perfect(small("jello")), 2))
        assert 0.8 < np.hypot(*shift.T).max() < 1.6
        assert np.abs(shift.mean(axis=0)).max() < 0.25

    def test_settled_ground_was_surveyed_too_high(self):
        hidden = generate(small("ground_motion", control=11), 2)
        rise = moved(hidden, "ground", ["z"])[:, 0]
        control = (hidden.block.ground["role"] == "control").to_numpy()
        assert rise[control].max() > 0.04 and rise.min() == 0.0 and not rise[~control].any()
        where = hidden.truth["effects"][0]["where"]
        ground = np.array(list(hidden.truth["ground"].values()))
        far = np.hypot(ground[:, 0] - where["x"], ground[:, 1] - where["y"])
        assert far[np.argmax(rise)] < 20

    def test_the_camera_steps_once_within_a_flight(self):
        hidden = generate(perfect(small("camera_step")), 2)
        where = hidden.truth["effects"][0]["where"]
        late = (hidden.block.images["time_s"] > where["time_s"]).to_numpy()
        late = late[hidden.block.image_rows("tie_points")]
        assert not moved(hidden)[~late].any()
        assert np.hypot(*moved(hidden)[late].T).mean() == pytest.approx(4.0, rel=0.2)

    def test_the_focus_keeps_for_some_images(self):
        hidden = generate(small("focus_hunting", images=80), 2)
        gain = np.array(list(hidden.truth["effects"][0]["per_image"]["f"].values()))
        assert gain.std() == pytest.approx(6.0) and 4 < len(np.unique(gain)) < 25

    def test_a_creeping_bank_moves_by_the_slide_from_first_to_last_image(self):
        """0.1 m at f / 50 m are 11 px between the first and the last image, half of it each."""
        shift = moved(generate(perfect(small("ground_creep", images=40)), 2))
        assert np.hypot(*shift.T).max() == pytest.approx(5.5, rel=0.25)


class TestNoise:
    def test_tie_errors_have_the_stated_size(self):
        """Of 20,000 draws: 1 % for the normal and the log-normal, 5 % for tails of nu = 5."""
        for noise, tolerance in ((NOISES["clean"], 0.01), (NOISES["coarse"], 0.01),
                                 (replace(NOISES["everyday"], gross=0.0), 0.05)):  # fmt: skip
            error, wrong, _ = of_ties(20_000, noise, np.random.default_rng(1))
            assert error.std() == pytest.approx(noise.tie_px, rel=tolerance) and not wrong.any()

    def test_a_sigma_of_each_observation_scales_its_error(self):
        """Log-normal; what is left after division is Student's t of variance one."""
        noise = replace(NOISES["heavy_tails"], nu=8.0)
        case = Case(noise=noise, sigma_column=True, **SMALL | {"observations": 400})
        block, exact = generate(case, 2).block, generate(perfect(case), 2).block
        sigma = block.tie_points["sigma"]
        assert np.log(sigma).std() == pytest.approx(0.4, rel=0.05)
        error = (block.tie_points[["x", "y"]] - exact.tie_points[["x", "y"]]).div(sigma, axis=0)
        assert error.to_numpy().std() == pytest.approx(1.0, rel=0.05)

    def test_five_per_cent_are_wrong_matches_and_the_truth_names_them(self):
        hidden = generate(null("outliers", **SMALL | {"observations": 200}), 2)
        clean = generate(perfect(null("clean", **SMALL | {"observations": 200})), 2)
        columns = ["x", "y"]
        error = hidden.block.tie_points[columns].to_numpy() - clean.block.tie_points[columns]
        far = np.flatnonzero(np.hypot(error["x"], error["y"]) > 2.0)
        assert len(far) / len(error) == pytest.approx(0.05, abs=0.01)
        assert set(far) <= set(hidden.truth["wrong_matches"])

    def test_coloured_noise_forgets_in_its_own_time(self):
        """After tau the correlation is 1 / e; 20,000 epochs of 60 s: standard error 0.05."""
        noise = replace(NOISES["coloured_gnss"], gnss_white_m=(0.0, 0.0, 0.0))
        time_s = np.arange(20_000.0)
        error = of_gnss(time_s, np.zeros(20_000), noise, np.random.default_rng(1))[:, 0]
        assert error.std() == pytest.approx(0.008, rel=0.15)
        later = np.corrcoef(error[60:], error[:-60])[0, 1]
        assert later == pytest.approx(np.exp(-1), abs=0.12)

    def test_the_track_leads_to_the_exposures_within_some_millimetres(self):
        """A cubic through 1 Hz in gusts of 0.3 m and 3 s: 1 mm rms; a line would be 7 mm off."""
        at, between = (
            generate(perfect(Case(gnss=gnss, **SMALL | {"images": 60})), 3).block
            for gnss in ("exposures", "interpolated")
        )
        off = between.gnss[NUMBERS].to_numpy() - at.gnss[NUMBERS].to_numpy()
        assert 1e-5 < off.std() < 0.003
        line = [np.interp(at.images["time_s"], between.track["time_s"], between.track[axis])
                for axis in NUMBERS]  # fmt: skip
        assert 0.003 < (np.array(line).T - at.gnss[NUMBERS].to_numpy()).std() < 0.02

    def test_an_image_in_a_gap_of_the_track_has_no_antenna(self):
        block = generate(Case(gnss="interpolated", gaps=2, **SMALL | {"images": 60}), 3).block
        assert 40 < len(block.gnss) < 60 and np.diff(block.track["time_s"]).max() > 5


def test_a_geometry_or_an_effect_that_cannot_be_is_refused():
    with pytest.raises(ValueError, match="use one of nadir"):
        generate(Case(geometry="spiral"), 1)
    with pytest.raises(ValueError, match="needs two flights"):
        generate(Case({"focal_per_flight": 1.0}, **SMALL), 1)


@pytest.mark.slow
def test_180_images_and_60_000_observations_take_less_than_5_s():
    case = single("rolling_shutter", images=180, strips=3, observations=335)
    generate(replace(case, images=20), 1)  # what is loaded at its first use
    began = time.process_time()
    hidden = generate(case, 1)
    assert time.process_time() - began < 5.0
    assert len(hidden.block.tie_points) > 59_000 and len(hidden.block.images) == 180
