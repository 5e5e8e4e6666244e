"""Effects on the image point by hand: size, sign and direction."""

from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from hovering import HEIGHT, F, hovering, seen
from numpy.polynomial.legendre import Legendre
from strips import corridor_block

import corridor
from corridor.core.block import Block
from corridor.core.camera import undistort
from corridor.core.effects import (
    Context,
    Effect,
    EffectValues,
    Images,
    Parameter,
    Stack,
    Values,
    add,
    find,
    predict,
    take_out,
)
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.geometry import quaternion_from_rotation, rotation_from_quaternion

ACROSS, DOWN = 2000.0, 1500.0  # px from the middle of the picture to its edges


def moved(block, **values):
    """How far the points at the middle, top, bottom, left and right move, px."""
    return seen(block, **values) - seen(block)


def over_the_picture(slug, values, places):
    """Shift (n, 2) at places x, y (n, 2) of -1..1 over the picture."""
    half = np.array([ACROSS, DOWN])
    images = Images.of(hovering())
    pixel = half + half * np.asarray(places, float)
    look = Context(images, np.zeros(len(pixel), int), pixel=pixel, ray=(pixel - half) / F)
    return find(slug).shift(look, np.atleast_2d(values))[0]


class TestBeyondAllNumbers:
    """Image points with y pointing up drive an adjustment there."""

    @staticmethod
    def evaluate(pixel):
        block = hovering()
        stack = Stack(block, [find("row_polynomial")])
        look = Context(Images.of(block), np.zeros(1, int), pixel=np.array([pixel]))
        return stack.evaluate("image", look, stack.start())

    @pytest.mark.filterwarnings("error")
    def test_no_warning_is_printed(self):
        assert np.isinf(self.evaluate([0.0, 1e200])[1]).any()

    def test_no_cell_is_said_to_be_missing_of_an_effect_that_needs_none(self):
        with pytest.raises(AdjustmentFailed, match="far outside their picture"):
            self.evaluate([0.0, np.nan])


class TestHeat:
    """Two images, 20 and 30 C: 5 degrees on either side of the middle."""

    @staticmethod
    def two(cold=20.0, warm=30.0):
        block = hovering(temperature_c=cold)
        image = block.images.iloc[0].to_dict()
        rows = [image, image | {"image": "b", "temperature_c": warm}]
        tie_points = block.tie_points.assign(image="b")
        return Block(
            name="two", cameras=block.cameras, images=type(block.images)(rows),
            tie_points=tie_points, points=block.points,
        )  # fmt: skip

    def test_a_tenth_of_a_pixel_a_degree_moves_the_edge_half_a_pixel_in_five_degrees(self):
        """Issue 11: 0.1 px/C at the edge; at the top, 0.75 of the way, three quarters of it.

        The edge is where the point is seen: 2000.5 px out, it moves by 0.5 * 2000.5 / 2000.
        """
        out = moved(self.two(), thermal={"scale": 0.1})
        assert out[4] == pytest.approx([0.5, 0], abs=2e-4)
        assert out[3] == pytest.approx([-0.5, 0], abs=2e-4)
        assert out[1] == pytest.approx([0, -0.375], abs=2e-4)
        assert out[0] == pytest.approx([0, 0], abs=1e-12)

    def test_the_cubic_term_is_the_same_at_the_edge_and_an_eighth_half_way(self):
        places = [(1.0, 0.0), (0.5, 0.0)]
        block = self.two()
        images = Images.of(block)
        pixel = [ACROSS, DOWN] + np.array(places) * ACROSS
        look = Context(images, np.array([1, 1]), pixel=pixel)
        shift, _ = find("thermal").shift(look, np.array([[0.0, 0.1, 0.0, 0.0]]))
        assert shift == pytest.approx(np.array([[0.5, 0], [0.0625, 0]]), abs=1e-12)

    def test_the_shift_moves_all_points_alike_and_a_colder_camera_the_other_way(self):
        out = moved(self.two(), thermal={"x": 0.1, "y": -0.02})
        assert out == pytest.approx(np.tile([0.5, -0.1], (5, 1)), abs=1e-9)
        out = moved(self.two(cold=30.0, warm=20.0), thermal={"x": 0.1, "y": -0.02})
        assert out == pytest.approx(np.tile([-0.5, 0.1], (5, 1)), abs=1e-9)

    def test_an_even_temperature_moves_nothing(self):
        assert not moved(self.two(cold=25.0, warm=25.0), thermal={"scale": 1.0, "x": 1.0}).any()


class TestUnflatness:
    def test_its_terms_are_legendre_polynomials_of_degree_2_to_4(self):
        """Against numpy's own series, at places drawn at random."""
        names = [p.name for p in find("sensor_unflatness").parameters(hovering())]
        assert len(names) == 24
        places = np.random.default_rng(0).uniform(-1, 1, (50, 2))
        for name in ("x_20", "y_11", "x_04", "y_31"):
            values = np.array([float(other == name) for other in names])
            expected = np.zeros((50, 2))
            i, j = int(name[2]), int(name[3])
            expected[:, "xy".index(name[0])] = Legendre.basis(i)(places[:, 0]) * Legendre.basis(j)(
                places[:, 1]
            )
            assert 2 <= i + j <= 4
            assert over_the_picture("sensor_unflatness", values, places) == pytest.approx(
                expected, abs=1e-12
            )

    def test_half_a_pixel_of_bow_is_half_a_pixel_at_both_edges_and_minus_a_quarter_inside(self):
        """P2(x) = (3 x^2 - 1) / 2."""
        out = moved(hovering(), sensor_unflatness={"x_20": 0.5})
        assert out[[0, 3, 4], 0] == pytest.approx([-0.25, 0.5, 0.5], abs=2e-3)
        assert not out[:, 1].any()


class TestDeformation:
    PLACES = np.stack(np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 17)), -1).reshape(
        -1, 2
    )

    def field(self, slug):
        """The shifts of every parameter by itself, (parameters, places) of those along x."""
        unknown = find(slug).parameters(hovering(time_s=0.0))
        half = len(unknown) // 2
        images = Images.of(hovering(time_s=0.0))
        pixel = [ACROSS, DOWN] + self.PLACES * [ACROSS, DOWN]
        look = Context(images, np.zeros(len(pixel), int), pixel=pixel)
        return find(slug).shift(look, np.zeros((1, 2 * half)))[1][:, 0, :half].T

    def test_a_fine_bump_is_held_by_the_grid_and_a_plane_is_not(self):
        """A wave of half the picture is met to 5 % beside planes; planes are left over mostly.

        Cubic splines with steps h miss a wave k by about (k h)^4 / 384; six steps across:
        (2 pi / 3)^4 / 384 = 5 %.
        """
        field = self.field("image_deformation").T
        x, y = self.PLACES.T
        planes = np.stack([np.ones_like(x), x, y], axis=1)

        def left(basis, wanted):
            found = np.linalg.lstsq(basis, wanted, rcond=None)[0]
            return np.sqrt(np.mean((basis @ found - wanted) ** 2) / np.mean(wanted**2))

        assert left(np.column_stack([field, planes]), np.cos(2 * np.pi * x)) < 0.05
        for plane in planes.T:
            assert left(field, plane) > 0.5

    def test_no_coefficients_make_a_plane(self):
        """60 of the 63 coefficients of a grid of 9 x 7 are left, all independent of planes."""
        field = self.field("image_deformation").T
        planes = np.column_stack([np.ones(len(self.PLACES)), self.PLACES])
        assert field.shape[1] == 60
        assert np.linalg.matrix_rank(np.column_stack([field, planes])) == 63

    def test_it_grows_with_time_from_the_middle_of_the_block(self):
        block = TestHeat.two()
        block.images["time_s"] = [100.0, 160.0]
        unknown = find("image_deformation_over_time").parameters(block)
        values = np.random.default_rng(1).normal(0, 1e-3, len(unknown))
        images = Images.of(block)
        look = Context(images, np.array([0, 1]), pixel=np.array([[700.0, 200.0]] * 2))
        early, late = find("image_deformation_over_time").shift(look, values[None])[0]
        assert late == pytest.approx(-early)
        # 30 s on either side; four times as far away in time, four times as much.
        block.images["time_s"] = [100.0, 340.0]
        look = Context(Images.of(block), np.array([1]), pixel=np.array([[700.0, 200.0]]))
        far = find("image_deformation_over_time").shift(look, values[None])[0][0]
        assert far == pytest.approx(4 * late)
        assert np.abs(late).max() > 1e-3


class TestRows:
    @pytest.mark.parametrize(
        "direction, first", [("down", 1), ("up", 2), ("right", 3), ("left", 4)]
    )
    def test_the_row_that_is_read_first_goes_one_way_and_the_last_the_other(self, direction, first):
        """s = -1 in the first row and 1 in the last; both at s^2 = 1."""
        last = {1: 2, 2: 1, 3: 4, 4: 3}[first]
        block = hovering(row_direction=direction)
        out = moved(block, row_polynomial={"x_linear": 0.3, "y_quadratic": 0.2})
        assert out[first] == pytest.approx([-0.3, 0.2], abs=1e-3)
        assert out[last] == pytest.approx([0.3, 0.2], abs=1e-3)
        assert out[0] == pytest.approx([0, 0], abs=1e-6)


class TestRefraction:
    @staticmethod
    def at(flying, ground=0.0, offset=0.0):
        """The five points seen from high above, heights in metres above the sea."""
        block = hovering(x=0.0, z=flying - offset)
        scale = (flying - ground) / HEIGHT
        block.points[["x", "y"]] *= scale
        block.points["z"] = ground - offset
        block.offset = np.array([0.0, 0.0, offset])
        return block

    def test_wolf_and_dewitts_formula_at_3500_m_over_ground_at_120_m(self):
        """K = 7.4e-4 * 3.38 * (1 - 0.02 * 6.88) = 0.002157 degrees.

        At tan(alpha) = 2000 / 5000 the ray leans out by K 0.4 = 15.06 microradians, and the
        picture there grows by f (1 + 0.4^2) of it: 0.0873 px.
        """
        out = moved(self.at(3500.0, 120.0), refraction={"fraction": 1.0})
        assert out[4] == pytest.approx([0.0873, 0], abs=5e-5)
        assert out[3] == pytest.approx([-0.0873, 0], abs=5e-5)
        assert out[0] == pytest.approx([0, 0], abs=1e-12)

    def test_it_agrees_with_the_air_of_the_standard_atmosphere(self):
        """delta = tan(alpha) / (H - h) * integral of (z - h) (-dn/dz) dz from h to H, within 5 %.

        n - 1 = 2.77e-4 at the sea (visible light, 15 C), in proportion to the density, which
        goes with (1 - 22.56e-6 z)^4.256: an own derivation, for nearly vertical rays.
        """
        z = np.linspace(0.0, 3000.0, 3001)
        index = 2.77e-4 * (1 - 22.56e-6 * z) ** 4.256
        slope = -np.gradient(index, z)
        delta = 0.4 * np.trapezoid(z * slope, z) / 3000.0
        out = moved(self.at(3000.0), refraction={"fraction": 1.0})
        assert out[4, 0] == pytest.approx(F * 1.16 * delta, rel=0.05)

    def test_a_drone_at_50_m_sees_a_thousandth_of_a_pixel(self):
        out = moved(self.at(50.0), refraction={"fraction": 1.0})
        assert 0.0005 < out[4, 0] < 0.002

    def test_heights_count_from_the_sea_and_not_from_the_blocks_zero(self):
        there = moved(self.at(3500.0, 120.0), refraction={"fraction": 1.0})
        here = moved(self.at(3500.0, 120.0, offset=100.0), refraction={"fraction": 1.0})
        assert here == pytest.approx(there, abs=1e-9)
        assert not np.allclose(
            there, moved(self.at(3380.0), refraction={"fraction": 1.0}), atol=1e-4
        )

    def test_points_move_away_from_the_nadir_also_where_the_camera_is_tilted(self):
        """30 degrees about the picture's x: the nadir lies off the middle, points flee from it."""
        tilt = np.radians(30.0) / 2
        block = self.at(3000.0)
        # Down is (w x y z) = (0 1 0 0); then a turn about the camera's x.
        block.images[["qw", "qx", "qy", "qz"]] = [[-np.sin(tilt), np.cos(tilt), 0.0, 0.0]]
        images = Images.of(block)
        nadir = images.rotation[0] @ [0, 0, -1]
        nadir = nadir[:2] / nadir[2]
        block.tie_points = block.tie_points.iloc[:1]
        ray = np.array([0.1, 0.2])
        ground = images.rotation[0].T @ [*ray, 1.0]
        block.points.loc[0, ["x", "y", "z"]] = images.centre[0] - ground * 3000.0 / ground[2]
        out = predict(block, {"refraction": {"fraction": 1.0}}).tie - predict(block).tie
        away = (ray - nadir) / np.linalg.norm(ray - nadir)
        assert out[0] @ away == pytest.approx(np.linalg.norm(out[0]), rel=1e-9)
        assert np.linalg.norm(out[0]) > 0.01


class TestWater:
    """The bed of a river: exact rays, traced forward from the camera, meet it where they must."""

    LEVEL, DEPTH = 3.0, 2.0
    INDEX = 1.333

    def over_water(self, tilt_deg=0.0):
        block = hovering()
        block.extra["effect"] = {"water_refraction": {"level": self.LEVEL}}
        half = np.radians(tilt_deg) / 2
        turned = rotation_from_quaternion(np.array([[np.cos(half), np.sin(half), 0.0, 0.0]]))
        nadir = Images.of(block).rotation
        block.images[["qw", "qx", "qy", "qz"]] = quaternion_from_rotation(turned @ nadir)
        lens = block.cameras["c"]
        block.cameras = {"c": lens.with_values(k1=-0.04, k2=0.02, p1=2e-4)}
        return block

    def traced(self, block, pixels, index):
        """Where rays of the picture end on the bed (n, 3): Snell's law for vectors."""
        images = Images.of(block)
        ray = undistort(pixels, images.interior[0])
        down = np.column_stack([ray, np.ones(len(ray))]) @ images.rotation[0]
        down /= np.linalg.norm(down, axis=1, keepdims=True)
        centre = images.centre[0]
        surface = centre + down * ((self.LEVEL - centre[2]) / down[:, 2])[:, None]
        ratio, cosine = 1.0 / index, -down[:, 2]
        along = np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
        inside = ratio * down + (ratio * cosine - along)[:, None] * [0.0, 0.0, 1.0]
        return surface + inside * (-self.DEPTH / inside[:, 2])[:, None]

    @pytest.mark.parametrize("index", [1.333, 1.5])
    @pytest.mark.parametrize("tilt_deg", [0.0, 35.0])
    def test_a_traced_ray_comes_back_to_its_pixel(self, index, tilt_deg):
        block = self.over_water(tilt_deg)
        x, y = np.meshgrid(np.linspace(0, 4000, 9), np.linspace(0, 3000, 7))
        pixels = np.column_stack([x.ravel(), y.ravel()])
        names = [f"B{n}" for n in range(len(pixels))]
        block.points = pd.DataFrame(
            {"point": names, **dict(zip("xyz", self.traced(block, pixels, index).T, strict=True))}
        )
        block.tie_points = pd.DataFrame({"point": names, "image": "a", "x": 0.0, "y": 0.0})
        block = Block(**{one.name: getattr(block, one.name) for one in fields(Block)})
        found = predict(block, {"water_refraction": {"raised": 1.0 - 1.0 / index}}).tie
        assert np.abs(predict(block).tie - pixels).max() > 5.0
        assert np.abs(found - pixels).max() < 1e-6

    def test_straight_below_the_bed_is_raised_by_a_quarter_of_its_depth(self):
        """d - d / 1.333 for rays near the vertical: 2 m of water look like 1.5 m."""
        block = self.over_water()
        block.points["z"] = self.LEVEL - self.DEPTH
        block.points[["x", "y"]] *= 1e-3
        block.cameras = hovering().cameras
        there = seen(block, water_refraction={"raised": 1.0 - 1.0 / self.INDEX})[1:]
        here = seen(block)[1:]
        height = HEIGHT - self.LEVEL
        raised = self.DEPTH - self.DEPTH / self.INDEX
        expected = (height + self.DEPTH) / (height + self.DEPTH - raised)
        assert np.linalg.norm(there, axis=1) / np.linalg.norm(here, axis=1) == pytest.approx(
            expected, rel=1e-6
        )

    def test_what_lies_above_the_water_does_not_move(self):
        block = self.over_water()
        block.points["z"] = self.LEVEL + 0.01
        assert not moved(block, water_refraction={"raised": 0.25}).any()

    def test_without_an_index_that_of_water_is_taken_out(self):
        block = self.over_water()
        assert find("water_refraction").stated(block) == {"raised": pytest.approx(0.333 / 1.333)}
        block.constants["water_refraction"]["index"] = 1.34
        assert find("water_refraction").stated(block) == {"raised": pytest.approx(0.34 / 1.34)}

    def test_an_effect_that_does_not_say_so_sees_no_object_points(self):
        look = Context(Images.of(hovering()), np.zeros(1, int), pixel=np.zeros((1, 2)))
        with pytest.raises(InputError, match="sees_points = True"):
            look.depth  # noqa: B018


class TestMeasuredPoint:
    """Effects that see the image point as it was measured: lenses from the image to the ray."""

    class Lens(Effect):
        slug, title, called = "lens_of_image", "Lens of the measured point", "a lens"
        place, unknowns = "image", [Parameter("k", "1", scale=0.1)]

        def shift(self, context, values):
            """k r^2 q of the measured point q from the middle, in half pictures."""
            half = (context.size - 1.0) / 2.0
            q = context.measured - half
            moved = ((q / half) ** 2).sum(axis=1, keepdims=True) * q
            return values * moved, moved[:, :, None]

    def put_in(self, block, k):
        """The block with the lens in it."""
        lens = self.Lens()
        value = np.array([[k]])
        return add(block, Values([EffectValues(lens, ["all"], lens.unknowns, value, 0.0 * value)]))

    def test_adjusting_with_them_is_adjusting_corrected_measurements(self):
        """The same poses to a millionth of their sigmas, and the same sum of squares."""
        block = corridor_block(images=8, strips=2, observations_per_image=60, control=4, seed=3)
        bent = corridor.simulation.add_noise(
            self.put_in(block, -0.01), tie_px=0.5, mark_px=0.5, gnss_m=0.02, control_m=0.01, seed=3
        )
        options = {"camera": "fixed", "lever_arm": "fixed", "weights": "stated"}
        one = corridor.adjust(bent, effects=[self.Lens()], **options)
        found = one.values["lens_of_image"]
        assert abs(found.value[0, 0] + 0.01) < 4.0 * found.sigma[0, 0]
        other = corridor.adjust(take_out(bent, one.values), **options)
        away = (one.state.centre - other.state.centre) / one.poses[["sx", "sy", "sz"]].to_numpy()
        assert np.abs(away).max() < 1e-6
        assert one.cost == pytest.approx(other.cost, rel=1e-9)

    def test_where_nothing_is_measured_it_is_the_modelled_point(self):
        seen = Context(Images.of(hovering()), np.zeros(1, int), pixel=np.array([[5.0, 6.0]]))
        assert seen.measured is seen.pixel
