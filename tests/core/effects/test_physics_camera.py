"""Effects on the camera's interior by hand: size, sign and who shares what."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hovering import F, context, hovering, seen
from strips import corridor_block

from corridor.core.camera import INTERIOR
from corridor.core.effects import Context, Images, find, predict

# Ray of the points at the left and right edge: 2000 / 5000.
U = 0.4


def moved(**values):
    """How far the points at the middle, top, bottom, left and right move, px."""
    return seen(hovering(), **values) - seen(hovering())


class TestStatedInteriorThatIsWrong:
    def test_a_focal_length_longer_by_10_px_moves_the_edge_outward_by_4(self):
        out = moved(focal={"f": 10.0})
        assert out[4] == pytest.approx([4.0, 0], abs=1e-9)
        assert out[1] == pytest.approx([0, -3.0], abs=1e-9)

    @pytest.mark.parametrize("name, power", [("k1", 3), ("k2", 5), ("k3", 7)])
    def test_radial_terms_grow_with_the_third_fifth_and_seventh_power(self, name, power):
        out = moved(radial_distortion={name: 1e-3})
        assert out[4] == pytest.approx([F * 1e-3 * U**power, 0], abs=1e-9)
        assert out[1] == pytest.approx([0, -F * 1e-3 * 0.3**power], abs=1e-9)

    def test_p1_moves_x_three_times_as_far_at_the_ends_of_x_as_at_the_ends_of_y(self):
        """p1 (r2 + 2 u u): Fraser's p1 is OpenCV's p2."""
        out = moved(decentring_distortion={"p1": 1e-4})
        assert out[4] == pytest.approx([F * 3e-4 * U**2, 0], abs=1e-9)
        assert out[1] == pytest.approx([F * 1e-4 * 0.3**2, 0], abs=1e-9)

    def test_affine_terms_stretch_x_and_shear_it(self):
        out = moved(affine_distortion={"b1": 1e-4, "b2": -2e-4})
        assert out[4] == pytest.approx([F * 1e-4 * U, 0], abs=1e-9)
        assert out[2] == pytest.approx([-F * 2e-4 * 0.3, 0], abs=1e-9)

    @pytest.mark.parametrize(
        "slug, size",
        [("radial_distortion", 2.0), ("decentring_distortion", 1.0), ("affine_distortion", 2.0)],
    )
    def test_the_first_terms_usual_size_is_that_of_the_issue_at_the_edge(self, slug, size):
        """Issue 11: radial 2, decentring 1, affine 2 px at the edge."""
        first = find(slug).parameters(hovering())[0]
        out = moved(**{slug: {first.name: first.scale}})
        assert out[4] == pytest.approx([size, 0], abs=1e-9)

    def test_an_effect_on_the_camera_is_a_camera_of_other_values(self):
        """To the last digits: adding it to the interior is all there is to it."""
        block = corridor_block(images=8, strips=2, observations_per_image=30)
        values = {
            "focal": {"f": 3.0},
            "radial_distortion": {"k1": 1e-3, "k3": -2e-3},
            "decentring_distortion": {"p2": 2e-4},
            "affine_distortion": {"b2": 1e-4},
        }
        there = predict(block, values).tie
        ((name, camera),) = block.cameras.items()
        change = {k: camera[k] + v for own in values.values() for k, v in own.items()}
        block.cameras = {name: camera.with_values(**change)}
        assert there == pytest.approx(predict(block).tie, abs=1e-9)

    def test_each_camera_has_its_own(self):
        block = corridor_block(images=8, strips=2, flights=2, observations_per_image=30)
        ((name, camera),) = block.cameras.items()
        block.cameras = {name: camera, "second": replace(camera, name="second")}
        second = np.arange(8) >= 4
        block.images.loc[second, "camera"] = "second"
        out = predict(block, {"focal": {"f": {"second": 5.0}}}).tie - predict(block).tie
        still = block.image_rows("tie_points") < 4
        assert not out[still].any()
        assert np.abs(out[~still]).max() > 1.0


class TestFlightsAndImages:
    @pytest.mark.parametrize(
        "slug, own, name",
        [
            ("focal_per_flight", "flight", "f"),
            ("principal_point_per_flight", "flight", "cy"),
            ("focal_per_image", "image", "f"),
        ],
    )
    def test_one_value_moves_the_images_that_share_it_and_no_other(self, slug, own, name):
        block = corridor_block(images=8, strips=2, flights=2, observations_per_image=30)
        images = Images.of(block)
        group = images.flight_names[1] if own == "flight" else images.names[5]
        mine = images.flight == 1 if own == "flight" else np.arange(8) == 5
        effect = find(slug)
        groups = 2 if own == "flight" else 8
        values = np.zeros((groups, len(effect.parameters(block))))
        column = [p.name for p in effect.parameters(block)].index(name)
        values[1 if own == "flight" else 5, column] = 2.5
        look = Context(images, np.arange(8))
        shift, _ = effect.shift(look, values[look.group(effect.group)])
        assert shift[:, INTERIOR.index(name)] == pytest.approx(np.where(mine, 2.5, 0.0))
        out = predict(block, {slug: {name: {group: 2.5}}}).tie - predict(block).tie
        assert out[mine[block.image_rows("tie_points")]].any()
        assert not out[~mine[block.image_rows("tie_points")]].any()


def line(**columns):
    """Images from one place with columns as given."""
    image = hovering().images.iloc[0].to_dict()
    count = len(next(iter(columns.values())))
    rows = [
        image | {"image": f"i{k}"} | {name: float(v[k]) for name, v in columns.items()}
        for k in range(count)
    ]
    block = hovering()
    return replace(
        block, images=pd.DataFrame(rows), tie_points=block.tie_points.assign(image="i0"),
        marks=None, gnss=None,
    )  # fmt: skip


FOLLOWS = {
    "camera_by_time": lambda values: line(time_s=values),
    "camera_by_temperature": lambda values: line(temperature_c=values),
    "camera_by_velocity": lambda values: line(vx=0 * values, vy=-values, vz=0 * values),
    "camera_by_depth": lambda values: line(z=values),
}


@pytest.mark.parametrize("slug", FOLLOWS)
class TestCurves:
    """30 images; the quantity as a bend that is denser at one end, with a gap."""

    QUANTITY = np.concatenate([np.linspace(20.0, 24.0, 20) ** 1.1, np.linspace(60, 90, 10)])

    def curves(self, slug):
        block = FOLLOWS[slug](self.QUANTITY)
        effect = find(slug)
        zero = np.zeros((30, len(effect.parameters(block))))
        return effect.shift(context(block), zero)[1]

    def fit(self, slug, wanted):
        """Share of wanted (30,) that the curves of the focal length leave over."""
        curves = self.curves(slug)[:, INTERIOR.index("f")]
        return np.linalg.norm(
            curves @ np.linalg.lstsq(curves, wanted, rcond=None)[0] - wanted
        ) / np.linalg.norm(wanted)

    def test_a_straight_line_and_a_parabola_are_among_them(self, slug):
        """But for their constant, which the camera itself has: fitted beside them."""
        curves = self.curves(slug)[:, INTERIOR.index("f")]
        with_constant = np.column_stack([curves, np.ones(30)])
        for wanted in (self.QUANTITY, self.QUANTITY**2):
            found = with_constant @ np.linalg.lstsq(with_constant, wanted, rcond=None)[0]
            assert found == pytest.approx(wanted, rel=1e-9)

    def test_the_constant_is_not(self, slug):
        assert self.fit(slug, np.ones(30)) > 0.3
        assert np.linalg.matrix_rank(self.curves(slug)[:, INTERIOR.index("f"), :5]) == 5

    def test_f_cx_and_cy_each_have_their_own(self, slug):
        curves = self.curves(slug)
        for n, name in enumerate(("f", "cx", "cy")):
            own = curves[:, INTERIOR.index(name)]
            assert own[:, 5 * n : 5 * n + 5].any()
            assert not np.delete(own, np.s_[5 * n : 5 * n + 5], axis=1).any()
        assert not np.delete(curves, [INTERIOR.index(n) for n in ("f", "cx", "cy")], axis=1).any()

    def test_a_quantity_that_never_changes_moves_nothing(self, slug):
        block = FOLLOWS[slug](np.full(6, 25.0))
        effect = find(slug)
        count = len(effect.parameters(block))
        shift, derivative = effect.shift(context(block), np.ones((6, count)))
        assert not shift.any() and not derivative.any()


class TestSteps:
    BLOCK = line(time_s=np.arange(16.0))

    def test_seven_steps_part_sixteen_images_into_pairs(self):
        effect = find("camera_step")
        assert effect.moments(Images.of(self.BLOCK)) == pytest.approx(np.arange(1.5, 14, 2))

    def test_steps_lie_in_the_pauses_between_strips(self):
        """Nine images, a turn of 10 s, four, a landing of 900 s, three."""
        time = np.r_[np.arange(9.0), 18.0 + np.arange(4), 921.0 + np.arange(3)]
        moments = find("camera_step").moments(Images.of(line(time_s=time)))
        assert moments.tolist() == [13.0, 471.0]

    def test_a_hard_landing_moves_all_images_after_it(self):
        """3 px from the third change on: images 0 to 5 as before, 6 to 15 with f + 3."""
        effect = find("camera_step")
        names = [p.name for p in effect.parameters(self.BLOCK)]
        values = np.where(np.array(names) == "f_3", 3.0, 0.0)
        shift, _ = effect.shift(context(self.BLOCK), np.tile(values, (16, 1)))
        assert shift[:, INTERIOR.index("f")].tolist() == [0.0] * 6 + [3.0] * 10

    def test_the_moment_may_be_named(self):
        effect = type(find("camera_step"))(at=(9.5,))
        assert [p.name for p in effect.parameters(self.BLOCK)] == ["f_1", "cx_1", "cy_1", "k1_1"]
        shift, _ = effect.shift(context(self.BLOCK), np.tile([0.0, 0.0, 1.0, 0.0], (16, 1)))
        assert shift[:, INTERIOR.index("cy")].tolist() == [0.0] * 10 + [1.0] * 6
