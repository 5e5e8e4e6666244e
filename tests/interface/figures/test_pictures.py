"""What a picture must be for every shape of block: legible, to scale, and true to its numbers."""

import dataclasses
import sys
import threading
from functools import cache

import numpy as np
import pandas as pd
import pytest
from made_up import adjustment, corridor
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

from corridor.core import output as report
from corridor.core.camera import Camera
from corridor.interface import figures
from corridor.interface.figures import maps, style


@cache
def thin():
    return corridor()


@cache
def square():
    return corridor(azimuth_deg=90, strips=10, images=8, length=550, ground=12)


@cache
def ring():
    """Sixty images around something, neither GNSS nor ground points nor strips."""
    block = corridor(strips=1, images=60, ground=1)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    images = block.images.drop(columns=["strip", "flight", "time_s"])
    images = images.assign(x=20 * np.cos(turn), y=20 * np.sin(turn))
    points = block.points.assign(x=block.points["x"] % 8, y=block.points["y"] % 8)
    return dataclasses.replace(
        block,
        name="ring",
        images=images,
        points=points,
        marks=None,
        ground=None,
        gnss=None,
        crs=None,
    )


@cache
def five_images():
    return corridor(strips=1, images=5, length=300, ground=2, name="five")


@cache
def two_cameras():
    block = corridor(strips=4, images=20)
    images = block.images.copy()
    images["camera"] = np.where(np.arange(len(images)) % 3 == 0, "P1", "backward_looking_camera")
    images["flight"] = np.where(np.arange(len(images)) < 40, "morning of the 24th", "evening")
    other = Camera.from_table("B", {"width": 4000, "height": 6000, "f": 5000.0})
    cameras = block.cameras | {"backward_looking_camera": other}
    name = "a block whose name fills more than the line that is there for it and goes on"
    return dataclasses.replace(block, name=name, images=images, cameras=cameras)


@cache
def nothing_known():
    block = corridor(images=6, ground=2)
    images = block.images[["image", "camera"]]
    return dataclasses.replace(
        block, images=images, points=None, gnss=None, ground=None, marks=None, crs=None
    )


# The thin corridor, the longest words and the least data; between them lie the others.
SHAPES = [
    thin, two_cameras, nothing_known,
    *(pytest.param(shape, marks=pytest.mark.slow) for shape in (square, ring, five_images)),
]  # fmt: skip
EFFECTS = [("focal", "f", f"DJI_{k:04d}.JPG", 0.1 * k, 0.05, "px") for k in range(28)]
DRAWINGS = {
    "first_look": lambda a: figures.first_look(a.block),
    "residual_vectors": figures.residual_vectors,
    "residuals_along": figures.residuals_along,
    "check_points": figures.check_points,
    "compare_check_points": lambda a: figures.compare_check_points(a, a, ("blind", "aware")),
    "check_points_moved": lambda a: figures.check_points_moved(a, a),
    "correlation_matrix": figures.correlation_matrix,
}


def written(figure):
    """Every text one sees, with its box in pixels."""
    figure.draw_without_rendering()
    texts = [*figure.texts, *(text for key in figure.legends for text in key.get_texts())]
    for axes in figure.axes:
        texts += axes.texts
        if axes.get_legend() is not None:
            texts += axes.get_legend().get_texts()
        if axes.axison:
            texts += [axes.title, axes._left_title, axes._right_title]
            for axis in (axes.xaxis, axes.yaxis):
                texts += [axis.label, *numbers(axis)]
    shown = [text for text in texts if text.get_visible() and text.get_text().strip()]
    return [(text.get_text(), text.get_window_extent()) for text in shown]


def numbers(axis):
    """Labels of the ticks that lie on an axis."""
    low, high = sorted(axis.get_view_interval())
    room = 1e-9 * (high - low)
    return [
        label
        for tick in axis.get_major_ticks()
        if low - room <= tick.get_loc() <= high + room
        for label in (tick.label1, tick.label2)
        if label.get_visible() and label.get_text()
    ]


def assert_legible(figure):
    texts = written(figure)
    for k, (one, box) in enumerate(texts):
        assert figure.bbox.x0 - 1 <= box.x0 and box.x1 <= figure.bbox.x1 + 1, one
        assert figure.bbox.y0 - 1 <= box.y0 and box.y1 <= figure.bbox.y1 + 1, one
        for other, second in texts[k + 1 :]:
            # A pixel of shared white space is none of ink.
            across = min(box.x1, second.x1) - max(box.x0, second.x0)
            upright = min(box.y1, second.y1) - max(box.y0, second.y0)
            assert across <= 1 or upright <= 1, f"{one!r} covers {other!r}"


@cache
def drawn(name, shape):
    return DRAWINGS[name](adjustment(shape()))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
@pytest.mark.parametrize("name", DRAWINGS)
class TestEveryPicture:
    def test_no_text_covers_another_or_leaves_the_sheet(self, name, shape):
        figure = drawn(name, shape)
        assert len(written(figure)) >= 2
        assert_legible(figure)

    def test_every_axis_names_what_it_counts(self, name, shape):
        for axes in drawn(name, shape).axes:
            if axes.axison and name != "correlation_matrix":
                for axis in (axes.xaxis, axes.yaxis):
                    assert axis.get_label_text() or not numbers(axis)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (n % 4 > 0)) for n, name in enumerate(DRAWINGS)],
)
def test_the_same_input_gives_the_same_bytes(name):
    one, two = (figures.png(DRAWINGS[name](adjustment(thin())), dpi=50) for _ in range(2))
    assert one == two and one.startswith(b"\x89PNG")


class TestStyle:
    def test_a_picture_shows_itself_in_a_notebook_without_pyplot(self):
        figure = figures.first_look(five_images())
        assert isinstance(figure, Figure)
        assert figure._repr_png_().startswith(b"\x89PNG")
        assert " at 0x" not in repr(figure)

    def test_pictures_can_be_drawn_in_threads(self):
        made = []
        work = [
            threading.Thread(
                target=lambda: made.append(figures.png(figures.first_look(five_images()), 50))
            )
            for _ in range(2)
        ]
        for thread in work:
            thread.start()
        for thread in work:
            thread.join()
        assert len(made) == 2 and len(set(made)) == 1

    def test_the_figures_do_not_need_pyplot(self):
        import subprocess

        code = (
            "import corridor.interface.figures, sys; sys.exit('matplotlib.pyplot' in sys.modules)"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

    def test_colours_of_series_differ_in_grey_print_or_in_marker(self):
        """Lightness by the luma of ITU-R BT.601; a tenth is told apart side by side."""
        grey = [
            np.dot([0.299, 0.587, 0.114], [int(c[k : k + 2], 16) / 255 for k in (1, 3, 5)])
            for c, _ in style.SERIES
        ]
        assert np.diff(sorted(grey)).min() > 0.08
        assert len({marker for _, marker in style.SERIES}) == len(style.SERIES)

    @pytest.mark.parametrize(
        ("value", "nice"), [(1.0, 1), (1.99, 1), (2.0, 2), (4.9, 2), (0.06, 0.05), (730, 500)]
    )
    def test_scales_are_one_two_or_five(self, value, nice):
        assert report.nice(value) == pytest.approx(nice)

    def test_a_name_with_dollars_is_not_read_as_a_formula(self):
        block = dataclasses.replace(thin(), name="cost $x_1$ and $y")
        assert figures.png(figures.first_look(block), 50)


class TestMap:
    @pytest.mark.parametrize("azimuth", [0.0, 62.0, 90.0, 152.0, 270.0])
    def test_a_corridor_lies_across_the_sheet_whatever_its_azimuth(self, azimuth):
        block = corridor(azimuth_deg=azimuth)
        frame = maps.frame_of(block)
        places = frame.place(maps.centres(block))
        assert frame.turned
        assert np.ptp(places[:, 0]) == pytest.approx(900, abs=10)
        assert np.ptp(places[:, 1]) == pytest.approx(60, abs=10)
        assert places[:, 0].min() == pytest.approx(0, abs=1e-6)

    def test_turning_keeps_lengths_and_the_north_arrow_points_north(self):
        block = corridor(azimuth_deg=62.0)
        frame = maps.frame_of(block)
        east_north = np.array([[3.0, 4.0]])
        assert np.linalg.norm(frame.turn(east_north)) == pytest.approx(5.0)
        # The corridor runs towards 62 degrees, which lies to the right: north is 62 degrees left.
        north = frame.turn(np.array([[0.0, 1.0]]))[0]
        assert np.degrees(np.arctan2(north[1], north[0])) == pytest.approx(62.0, abs=0.5)

    def test_a_block_that_is_no_corridor_keeps_north_up(self):
        frame = maps.frame_of(ring())
        assert not frame.turned
        assert frame.place([[3.0, 4.0]]) == pytest.approx(np.array([[3.0, 4.0]]))

    def test_metres_are_equally_long_in_both_directions(self):
        for shape in (thin, square, ring):
            figure = drawn("first_look", shape)
            figure.draw_without_rendering()
            plan = figure.axes[0]
            box = plan.get_window_extent()
            across, upright = np.ptp(plan.get_xlim()), np.ptp(plan.get_ylim())
            assert box.width / across == pytest.approx(box.height / upright, rel=1e-3)

    def test_one_wild_tie_point_does_not_shrink_the_map(self):
        block = thin()
        points = block.points.copy()
        points.loc[0, ["x", "y"]] = 90_000.0
        plan = figures.first_look(dataclasses.replace(block, points=points)).axes[0]
        assert np.ptp(plan.get_xlim()) < 1200

    def test_cameras_without_a_pose_stand_where_the_antenna_was(self):
        block = thin()
        images = block.images.copy()
        images.loc[3, ["x", "y", "z"]] = np.nan
        moved = maps.centres(dataclasses.replace(block, images=images))
        assert moved[3] == pytest.approx(block.gnss.loc[3, ["x", "y"]].to_numpy(dtype=float))


class TestFirstLook:
    def test_histogram_counts_every_tie_point_once(self):
        block = thin()
        axes = figures.first_look(block).axes
        bars = next(a for a in axes if a.get_ylabel() == "points")
        assert sum(patch.get_height() for patch in bars.patches) == len(block.points)

    def test_coverage_counts_every_observation_of_the_camera(self):
        block = two_cameras()
        owner = dict(zip(block.images["image"], block.images["camera"], strict=True))
        count = sum(
            owner[image] == "P1"
            for table in (block.tie_points, block.marks)
            for image in table["image"]
        )
        figure = figures.first_look(block, camera="P1")
        mesh = next(a for a in figure.axes if a.get_xlabel() == "x (px)").collections[0]
        assert mesh.get_array().sum() == count

    def test_it_says_so_when_no_position_is_known(self):
        texts = [text for text, _ in written(figures.first_look(nothing_known()))]
        assert any("no position is known" in text for text in texts)

    def test_points_of_very_many_images_share_the_last_bar(self):
        block = five_images()
        names = [f"{k}_{name}" for k in range(9) for name in block.images["image"]]
        images = pd.concat([block.images] * 9).assign(image=names)
        tie = pd.DataFrame({"point": "p", "image": images["image"], "x": 1.0, "y": 2.0})
        many = dataclasses.replace(block, images=images, tie_points=tie, marks=None, gnss=None)
        texts = [text for text, _ in written(figures.first_look(many))]
        assert "\u226520" in texts


class TestResidualVectors:
    def one_residual(self, vx, vy):
        block = thin()
        made = adjustment(block)
        table = made.residuals["tie"].copy()
        table["vx"], table["vy"], table["outlier"] = vx, vy, False
        made.residuals["tie"] = table
        return made

    def quivers(self, figure):
        return [c for a in figure.axes for c in a.collections if isinstance(c, Quiver)]

    def test_arrows_point_the_way_of_the_residuals_y_down(self):
        figure = figures.residual_vectors(self.one_residual(0.3, 0.4))
        field = max(self.quivers(figure), key=lambda quiver: quiver.N)
        assert field.U == pytest.approx(0.3) and field.V == pytest.approx(0.4)
        assert np.diff(field.axes.get_ylim())[0] < 0

    def test_the_stated_arrow_has_the_length_it_states(self):
        figure = figures.residual_vectors(self.one_residual(0.3, 0.4))
        figure.draw_without_rendering()
        field = max(self.quivers(figure), key=lambda quiver: quiver.N)
        key = min(self.quivers(figure), key=lambda quiver: quiver.N)

        def inches(quiver, length):
            box = quiver.axes.get_window_extent()
            per_unit = box.width / np.ptp(quiver.axes.get_xlim()) / figure.dpi
            return length / quiver.scale * per_unit

        stated = next(t for t, _ in written(figure) if t.endswith(" px"))
        assert inches(key, key.U[0]) == pytest.approx(
            inches(field, float(stated.removesuffix(" px"))), rel=1e-6
        )
        assert f"exaggerated {1 / field.scale:,.0f} times" in " ".join(
            t for t, _ in written(figure)
        )

    def test_outliers_do_not_bend_the_means(self):
        made = self.one_residual(0.3, 0.4)
        wild = made.residuals["tie"].index[:200]
        made.residuals["tie"].loc[wild, ["vx", "vy"]] = 500.0
        made.residuals["tie"].loc[wild, "outlier"] = True
        field = max(self.quivers(figures.residual_vectors(made)), key=lambda quiver: quiver.N)
        assert field.U == pytest.approx(0.3)

    def test_pure_noise_is_mostly_pale(self):
        """Of a bivariate normal mean, P(length > 2 sigma of the vector) = exp(-4) = 1.8 %."""
        made = adjustment(thin())
        noise = np.random.default_rng(1).normal(0, 0.5, (len(made.residuals["tie"]), 2))
        made.residuals["tie"][["vx", "vy"]] = noise
        made.residuals["tie"]["outlier"] = False
        fields = [q for q in self.quivers(figures.residual_vectors(made)) if q.zorder < 9]
        dark = sum(q.N for q in fields if q.zorder == 4 and q.axes.axison)
        assert dark < 0.08 * sum(q.N for q in fields)


class TestResidualsAlong:
    def test_the_rms_of_an_image_is_that_of_its_residuals(self):
        made = adjustment(thin())
        table = made.residuals["tie"]
        kept = table[~table["outlier"]]
        name = made.block.images["image"].iloc[7]
        expected = np.sqrt((kept.loc[kept["image"] == name, "vx"] ** 2).mean())
        figure = figures.residuals_along(made)
        dots = next(line for line in figure.axes[0].lines if line.get_label().startswith("x in"))
        at = maps.frame_of(made.block).place(maps.centres(made.block))[7, 0]
        nearest = np.argmin(np.abs(dots.get_xdata() - at))
        assert dots.get_ydata()[nearest] == pytest.approx(expected)

    def test_the_three_gnss_panels_have_one_scale(self):
        figure = figures.residuals_along(adjustment(thin()))
        panels = [a for a in figure.axes if a.get_ylabel()[:1] in "xyz" and a.get_ylabel()]
        assert len(panels) == 3
        assert len({panel.get_ylim() for panel in panels}) == 1

    def test_without_gnss_there_is_no_empty_panel(self):
        assert len(figures.residuals_along(adjustment(ring())).axes) == 1


class TestCheckPoints:
    def test_arrows_and_bars_have_one_stated_scale(self):
        made = adjustment(thin())
        made.check_points[["dx", "dy", "dz"]] = [0.03, 0.04, 0.05]
        figure = figures.check_points(made)
        arrows = next(c for c in figure.axes[0].collections if isinstance(c, Quiver))
        bars = next(c for c in figure.axes[0].collections if isinstance(c, LineCollection))
        plan = np.hypot(arrows.U, arrows.V) / arrows.scale
        height = np.array([segment[1, 1] - segment[0, 1] for segment in bars.get_segments()])
        assert plan == pytest.approx(height)  # 3-4-5
        assert (height > 0).all()
        assert f"exaggerated {height[0] / 0.05:,.0f} times" in " ".join(
            t for t, _ in written(figure)
        )

    def test_arrows_turn_with_the_map(self):
        made = adjustment(corridor(azimuth_deg=90.0))
        turned = adjustment(corridor(azimuth_deg=0.0))
        for one in (made, turned):
            one.check_points[["dx", "dy", "dz"]] = 0.0
        made.check_points["dx"] = 0.02  # east, along the corridor
        turned.check_points["dy"] = 0.02  # north, along the corridor
        for one in (made, turned):
            axes = figures.check_points(one).axes[0]
            arrows = next(c for c in axes.collections if isinstance(c, Quiver))
            assert arrows.U == pytest.approx(0.02, rel=1e-3)
            assert np.abs(arrows.V).max() < 1e-3

    def test_all_arrows_and_bars_lie_within_the_map(self):
        made = adjustment(thin())
        made.check_points["dz"] = [3.0, -3.0, 2.0, -1.0]
        axes = figures.check_points(made).axes[0]
        low, high = axes.get_ylim()
        bars = next(c for c in axes.collections if isinstance(c, LineCollection))
        ends = np.concatenate(bars.get_segments())[:, 1]
        assert low < ends.min() and ends.max() < high

    def test_without_check_points_it_says_what_that_means(self):
        texts = " ".join(t for t, _ in written(figures.check_points(adjustment(ring()))))
        assert "No check points" in texts

    def test_two_adjustments_are_compared_at_one_scale(self):
        one, two = adjustment(thin()), adjustment(thin(), seed=8)
        two.check_points["dz"] *= 20
        figure = figures.compare_check_points(one, two, ("blind", "aware"))
        arrows = [c for a in figure.axes for c in a.collections if isinstance(c, Quiver)]
        panels = [a for a in figure.axes if a.get_xlabel()]
        assert len({q.scale for q in arrows if q.axes in panels}) == 1
        assert len({panel.get_xlim() for panel in panels}) == 1
        texts = " ".join(t for t, _ in written(figure))
        assert "blind: RMS" in texts and "aware: RMS" in texts

    def test_one_of_two_adjustments_may_have_no_check_points(self):
        one, two = adjustment(thin()), adjustment(thin())
        two.check_points = two.check_points.iloc[:0]
        assert figures.png(figures.compare_check_points(one, two), 50)


class TestCorrelationMatrix:
    def test_what_is_above_095_is_written_with_its_sign(self):
        made = adjustment(thin())
        matrix = np.eye(3)
        matrix[0, 1] = matrix[1, 0] = -0.9712
        matrix[0, 2] = matrix[2, 0] = 0.94
        names = ["camera.P1.f", "camera.P1.k1", "lever_arm.1.z"]
        made.correlation_matrix = pd.DataFrame(matrix, names, names)
        texts = [text for text, _ in written(figures.correlation_matrix(made))]
        assert "\u2212.971" in texts
        assert not any("940" in text for text in texts)
        assert "f" in texts and "lever_arm.1.z" in texts

    def test_a_coefficient_below_one_is_never_written_as_one(self):
        made = adjustment(thin())
        matrix = np.array([[1, 0.99996], [0.99996, 1]])
        names = ["camera.P1.f", "gnss_bias.z"]
        made.correlation_matrix = pd.DataFrame(matrix, names, names)
        texts = [text for text, _ in written(figures.correlation_matrix(made))]
        assert ".999+" in texts

    def test_of_many_parameters_the_strongest_are_shown_and_the_rest_counted(self):
        effects = [("focal", "f", f"image{k}", 0.1, 0.05, "px") for k in range(90)]
        made = adjustment(thin(), effects=effects)
        texts = [text for text, _ in written(figures.correlation_matrix(made))]
        assert any("the 40 of 98 parameters" in text for text in texts)
        assert {"k1", "k2", "k3"} <= set(texts)

    def test_forty_names_do_not_overlap(self):
        figure = figures.correlation_matrix(adjustment(thin(), effects=EFFECTS))
        names = [(t, b) for t, b in written(figure) if t.startswith("focal")]
        assert len(names) == 2 * len(EFFECTS)
        rows = sorted((b for _, b in names if b.width > b.height), key=lambda b: b.y0)
        assert all(low.y1 <= high.y0 + 1 for low, high in zip(rows, rows[1:], strict=False))

    def test_an_undetermined_parameter_leaves_its_row_empty(self):
        made = adjustment(thin())
        matrix = made.correlation_matrix.copy()
        matrix.iloc[2] = np.nan
        matrix.iloc[:, 2] = np.nan
        made.correlation_matrix = matrix
        assert figures.png(figures.correlation_matrix(made), 50)


@pytest.mark.slow
class TestRealBlocks:
    @pytest.mark.parametrize(
        "name", ["saraburi/block", "strasbourg", "roma", "sequoia/flight_block"]
    )
    def test_every_picture_of_a_real_block_is_legible(self, name, real_data):
        import corridor as package

        made = adjustment(package.read(real_data / name))
        for drawing in DRAWINGS.values():
            assert_legible(drawing(made))
