"""The camera: values worked out by hand, OpenCV's own projection, and the way back."""

import itertools
import json

import cv2
import numpy as np
import pytest

from corridor.core.camera import (
    FRASER8,
    FRASER10,
    INTERIOR,
    Camera,
    distort,
    image_to_ray,
    interior_derivatives,
    parameters_named,
    project,
    project_rays,
    projection_derivatives,
    undistort,
)
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.tools.formats.cameras import from_image_formula


def camera(width=5120, height=3840, **values):
    table = {"width": width, "height": height, "f": 5489.0, "cx": 2571.5, "cy": 1911.5}
    return Camera.from_table("made", table | values)


RADIAL = {"k1": -0.12, "k2": 0.07, "k3": -0.015}
DECENTRING = {"p1": 4e-4, "p2": -3e-4}
CAMERAS = {
    "no distortion": camera(),
    "8 parameters": camera(**RADIAL, **DECENTRING),
    "10 parameters": camera(**RADIAL, **DECENTRING, b1=-3e-4, b2=2e-4),
    "long radial": camera(
        **DECENTRING, k1=-0.12, k2=0.07, k3=-0.03, k4=0.012, k5=-4e-3, k6=1e-3, k7=-2e-4, k8=2e-5
    ),
    # A drone's wide lens, 84 degrees across the diagonal; a corner moves by 300 px.
    "wide": camera(5472, 3648, f=3650.0, cx=2735.5, cy=1823.5, k1=-0.27, k2=0.11, k3=-0.03),
}
every_camera = pytest.mark.parametrize("lens", CAMERAS.values(), ids=CAMERAS)


def picture(lens, columns=57, rows=43):
    """Pixels over the whole picture, corners and edges included."""
    x, y = np.meshgrid(
        np.linspace(0, lens.width - 1, columns), np.linspace(0, lens.height - 1, rows)
    )
    return np.column_stack([x.ravel(), y.ravel()])


class TestProjectionByHand:
    """f = 1000, principal point (500, 400), the ray (0.3, 0.4): r2 = 0.25. Design, section 2."""

    RAY = np.array([[0.3, 0.4]])

    @pytest.mark.parametrize(
        "values, x, y",
        [
            ({}, 800.0, 800.0),
            # radial = 1 + 0.1 * 0.25
            ({"k1": 0.1}, 500 + 307.5, 400 + 410.0),
            # radial = 1 + 0.16 * 0.0625
            ({"k2": 0.16}, 500 + 303.0, 400 + 404.0),
            # radial = 1 + 0.64 * 0.015625
            ({"k3": 0.64}, 500 + 303.0, 400 + 404.0),
            # radial = 1 + 0.25**8, of one part in 65536
            ({"k8": 1.0}, 500 + 300 * (1 + 1 / 65536), 400 + 400 * (1 + 1 / 65536)),
            # p1 (r2 + 2 u u), 2 p1 u v = 0.001 * 0.43, 0.001 * 0.24
            ({"p1": 0.001}, 800.43, 800.24),
            # 2 p2 u v, p2 (r2 + 2 v v) = 0.001 * 0.24, 0.001 * 0.57
            ({"p2": 0.001}, 800.24, 800.57),
            ({"b1": 0.001}, 800.3, 800.0),
            ({"b2": 0.001}, 800.4, 800.0),
        ],
    )
    def test_each_parameter_moves_the_point_by_the_formula(self, values, x, y):
        lens = Camera.from_table(
            "c", {"width": 1001, "height": 801, "f": 1000.0, "cx": 500.0, "cy": 400.0} | values
        )
        assert project_rays(self.RAY, lens.interior)[0] == pytest.approx([x, y], abs=1e-11)

    def test_a_point_to_the_right_and_below_is_to_the_right_and_below_in_the_picture(self):
        """Camera 10 m above the origin, looking down, picture's top to the north."""
        look_down = np.diag([1.0, -1.0, -1.0])
        lens = Camera.from_table("c", {"width": 101, "height": 81, "f": 100.0})
        east_south = np.array([[1.0, -2.0, 0.0]])
        seen = project(east_south, np.array([0.0, 0.0, 10.0]), look_down, lens.interior)
        assert seen[0] == pytest.approx([50 + 10, 40 + 20], abs=1e-12)

    def test_the_principal_point_defaults_to_the_middle_of_the_outer_pixel_centres(self):
        lens = Camera.from_table("c", {"width": 5120, "height": 3840, "f": 1.0})
        assert (lens["cx"], lens["cy"]) == (2559.5, 1919.5)

    def test_rows_choose_the_interior_of_each_ray(self):
        table = np.stack([CAMERAS["8 parameters"].interior, CAMERAS["wide"].interior])
        rays = np.array([[0.1, 0.2], [0.1, 0.2], [-0.3, 0.1]])
        both = project_rays(rays, table, np.array([1, 0, 1]))
        assert np.array_equal(both[[0, 2]], project_rays(rays[[0, 2]], table[1]))
        assert np.array_equal(both[[1]], project_rays(rays[[1]], table[0]))


@pytest.mark.parametrize("name", ["no distortion", "8 parameters", "wide"])
def test_opencv_projects_to_the_same_pixel(name):
    """cv2.projectPoints with its p1, p2 for our p2, p1: rounding only."""
    lens = CAMERAS[name]
    rng = np.random.default_rng(1)
    points = rng.uniform([-30, -25, -3], [30, 25, 3], (500, 3))
    turn = rotation_from_vector(np.array([np.pi - 0.2, 0.1, -0.15]))
    centre = np.array([2.0, -1.0, 60.0])
    matrix = np.array([[lens["f"], 0, lens["cx"]], [0, lens["f"], lens["cy"]], [0, 0, 1]])
    theirs, _ = cv2.projectPoints(
        points,
        cv2.Rodrigues(turn)[0],
        -turn @ centre,
        matrix,
        np.array([lens["k1"], lens["k2"], lens["p2"], lens["p1"], lens["k3"]]),
    )
    ours = project(points, centre, turn, lens.interior)
    assert np.isfinite(ours).all()
    assert np.abs(ours - theirs[:, 0]).max() < 1e-9


def test_a_point_behind_the_camera_or_beside_it_has_no_image():
    lens = CAMERAS["8 parameters"]
    points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    seen = project(points, np.zeros(3), np.eye(3), lens.interior)
    assert np.isfinite(seen).all(axis=1).tolist() == [True, False, False]


class TestDerivatives:
    """Analytic against central differences: relative 1e-6 of the largest."""

    RAYS = np.random.default_rng(2).uniform(-0.5, 0.5, (60, 2))

    @pytest.mark.parametrize("parameter", INTERIOR)
    @every_camera
    def test_by_every_interior_parameter(self, lens, parameter):
        k = INTERIOR.index(parameter)
        step = 1e-3 * np.eye(len(INTERIOR), 16)[k] * (100 if k < 3 else 1)
        high, low = (project_rays(self.RAYS, lens.interior + s) for s in (step, -step))
        numeric = (high - low) / (2 * step[k])
        analytic = interior_derivatives(self.RAYS, lens.interior)[:, :, k]
        assert np.abs(analytic).max() > 0
        assert np.abs(analytic - numeric).max() < 1e-6 * np.abs(analytic).max()

    @every_camera
    def test_by_the_ray(self, lens):
        interior = np.ascontiguousarray(lens.interior[None])
        for u, v in self.RAYS[:20]:
            _, _, xu, xv, yu, yv = distort(u, v, interior, np.uint64(0), 8)
            h = 1e-5
            rays = np.array([[u + h, v], [u - h, v], [u, v + h], [u, v - h]])
            at = project_rays(rays, lens.interior)
            numeric = np.column_stack([at[0] - at[1], at[2] - at[3]]) / (2 * h)
            assert np.array([[xu, xv], [yu, yv]]) == pytest.approx(numeric, abs=1e-6 * lens["f"])


class TestTheWayBack:
    @every_camera
    def test_undistort_undoes_project_to_a_billionth_of_a_pixel_over_the_whole_picture(self, lens):
        pixels = picture(lens)
        again = project_rays(undistort(pixels, lens.interior), lens.interior)
        assert np.abs(again - pixels).max() < 1e-9

    @every_camera
    def test_project_undoes_undistort_on_rays(self, lens):
        rays = undistort(picture(lens), lens.interior)
        again = undistort(project_rays(rays, lens.interior), lens.interior)
        assert np.abs(again - rays).max() * lens["f"] < 1e-9

    def test_without_distortion_a_pixel_is_its_ray(self):
        lens = CAMERAS["no distortion"]
        ray = undistort(np.array([[2571.5 + 548.9, 1911.5 - 54.89]]), lens.interior)
        assert ray[0] == pytest.approx([0.1, -0.01], abs=1e-15)

    def test_a_pixel_beyond_the_fold_has_no_ray(self):
        """k1 = -1/3: u (1 - u^2 / 3) folds at u = 1, where it is 2/3."""
        lens = Camera.from_table("c", {"width": 2001, "height": 2001, "f": 1000.0, "k1": -1 / 3})
        ahead = 1000 + 1000 * np.array([0.5, 0.66, 2 / 3 - 1e-6, 2 / 3 + 1e-6, 0.7, 0.99])
        rays = undistort(np.column_stack([ahead, np.full(6, 1000.0)]), lens.interior)
        assert np.isfinite(rays).all(axis=1).tolist() == [True] * 3 + [False] * 3
        assert (rays[:3, 0] < 1).all()

    def test_a_ray_of_a_second_branch_beyond_the_fold_is_not_taken_for_the_pixels(self):
        """u (1 - 0.3 u^2 + 0.04 u^4) falls between u^2 = 2 and 2.5 and rises again."""
        lens = Camera.from_table(
            "c", {"width": 2001, "height": 2001, "f": 1000.0, "k1": -0.3, "k2": 0.04}
        )
        fold = np.sqrt(2) * (1 - 0.6 + 0.16)
        ahead = 1000 + 1000 * np.array([0.3, fold - 1e-4, fold + 1e-4, 0.85, 0.99])
        rays = undistort(np.column_stack([ahead, np.full(5, 1000.0)]), lens.interior)
        assert np.isfinite(rays).all(axis=1).tolist() == [True, True, False, False, False]


def from_image_to_ray(lens):
    """Our camera for one whose polynomial goes from the image to the ray, and the difference."""
    return from_image_formula(lens, lambda pixels: image_to_ray(pixels, lens.interior))


class TestImageToRay:
    def test_the_polynomial_by_hand(self):
        """f 1000, pixel 300 and 400 off: u, v = 0.3, 0.4, factor 1 + 0.1 * 0.25."""
        interior = np.zeros(15)
        interior[[0, INTERIOR.index("k1")]] = 1000.0, 0.1
        ray = image_to_ray(np.array([[300.0, 400.0]]), interior)
        assert ray[0] == pytest.approx([0.3075, 0.41], abs=1e-15)

    @pytest.mark.parametrize(
        "lens",
        [camera(k1=0.05), camera(**DECENTRING, k1=0.05, k2=-0.02, k3=0.01)],
        ids=["one radial", "8 parameters"],
    )
    def test_the_largest_difference_that_is_stated_is_the_largest_there_is(self, lens):
        ours, worst = from_image_to_ray(lens)
        pixels = picture(lens, 101, 81)
        rays = image_to_ray(pixels, lens.interior)
        off = project_rays(rays, ours.interior) - pixels
        # A finer grid may find a little more between the nodes of the coarser one, or rounding.
        far = np.linalg.norm(off, axis=1).max()
        assert far == pytest.approx(worst, rel=0.05, abs=1e-9)
        bare = project_rays(rays, np.r_[ours.interior[:3], np.zeros(12)]) - pixels
        assert 0 < worst < 0.01 * np.linalg.norm(bare, axis=1).max()

    def test_no_distortion_stays_none(self):
        ours, worst = from_image_to_ray(camera())
        assert worst < 1e-9
        assert np.abs(ours.interior[3:]).max() < 1e-9

    def test_dbats_published_roma_camera_converts_to_a_fifth_of_a_pixel(self, real_data):
        """DBAT, romabundledemo/result/report.txt: f in mm, K1, K2 in 1/mm^2, 1/mm^4."""
        known = json.loads((real_data / "roma" / "expected.json").read_text())
        dbat = known["published"]["script"]
        lens = Camera.from_table(
            "EOS 5D",
            {"width": 5616, "height": 3744}
            | {name: dbat[f"{name}_px"] for name in ("f", "cx", "cy")}
            | {"k1": dbat["K1_per_mm2"] * dbat["f_mm"] ** 2}
            | {"k2": dbat["K2_per_mm4"] * dbat["f_mm"] ** 4},
        )
        ours, worst = from_image_to_ray(lens)
        assert worst < 0.2
        # The first term of the inverse series is the first term with the other sign.
        assert ours["k1"] == pytest.approx(-lens["k1"], rel=0.1)

    def test_a_polynomial_that_folds_in_any_corner_is_refused(self):
        """u (1 - r2 / 2.4): folds at r2 = 0.8, which one corner alone reaches."""
        off = {"f": 5000.0, "cx": 1000.0, "cy": 1000.0, "k1": -1 / 2.4}
        for flip in itertools.product([False, True], repeat=2):
            values = dict(off)
            if flip[0]:
                values["cx"] = 5119 - values["cx"]
            if flip[1]:
                values["cy"] = 3839 - values["cy"]
            with pytest.raises(InputError, match="folds inside the picture"):
                from_image_to_ray(camera(**values))


GOOD = {"width": 4000, "height": 3000, "f": 3600.0}


class TestCameraTable:
    def test_a_table_comes_back_as_it_was(self):
        table = GOOD | {"cx": 1999.0, "cy": 1490.0, "k1": -0.05, "p2": 1e-4, "b1": 2e-5, "k8": 1e-9}
        table |= {"pixel_um": 2.4, "readout_s": 0.03, "row_direction": "left", "calibrated": True}
        table |= {"serial": "0017"}
        assert Camera.from_table("P1", table).to_table() == table

    @pytest.mark.parametrize(
        "change, message",
        [
            ({"width": None}, "has no width"),
            ({"f": None, "height": None}, "has no height and no f"),
            ({"f": "long"}, "f = 'long' is not a number"),
            ({"f": True}, "f = True is not a number"),
            ({"f": 0.0}, "f = 0 is not positive"),
            ({"k1": float("nan")}, "k1 = nan is not finite"),
            ({"cx": float("inf")}, "cx = inf is not finite"),
            ({"width": 4000.5}, "width = 4000.5 is not a picture size"),
            ({"height": 1}, "height = 1 is not a picture size"),
            ({"k3": 1e20}, r"k3 = 1e\+20 moves the corner of the picture"),
            ({"pixel_um": 0}, "pixel_um = 0 is not positive"),
            ({"readout_s": -0.03}, "readout_s = -0.03 is negative"),
            ({"row_direction": "sideways"}, "row_direction = 'sideways' is unknown"),
            ({"calibrated": 1}, "calibrated = 1 is not true or false"),
        ],
    )
    def test_what_cannot_be_a_camera_is_refused_with_its_name(self, change, message):
        table = {key: value for key, value in (GOOD | change).items() if value is not None}
        with pytest.raises(InputError, match=r"\[camera\.P1\].*" + message):
            Camera.from_table("P1", table)

    def test_values_are_replaced_by_name_and_the_camera_itself_stays(self):
        before = Camera.from_table("P1", GOOD)
        after = before.with_values(f=3700.0, k2=0.1)
        assert (after["f"], after["k2"], before["f"], before["k2"]) == (3700.0, 0.1, 3600.0, 0.0)

    def test_sets_of_parameters_have_their_names(self):
        assert parameters_named("fraser8") == FRASER8
        assert set(parameters_named("fraser10")) == {*FRASER8, "b1", "b2"} == set(FRASER10)
        assert parameters_named("fixed") == ()
        assert set(parameters_named("f, k2,cx")) == {"f", "cx", "k2"}
        with pytest.raises(InputError, match="camera parameter k9 is unknown"):
            parameters_named("f,k9")


@pytest.mark.parametrize("name", CAMERAS)
def test_derivatives_of_a_projection_are_its_differences(name):
    """Steps of 1e-5 leave 1e-10 of a derivative's curve, and rounding of 4000 px / 1e-5 1e-7 px."""
    lens = CAMERAS[name].interior
    noise = np.random.default_rng(2)
    points = noise.uniform([-20, -15, -2], [20, 15, 2], (30, 3))
    centre, turn = np.array([1.0, 2.0, 60.0]), rotation_from_vector(np.array([3.1, 0.1, -0.05]))
    found = projection_derivatives(points, centre, turn, lens)
    h = 1e-5
    for k, step in enumerate(h * np.eye(3)):
        moves = {
            "by_point": lambda s, d=step: project(points + s * d, centre, turn, lens),
            "by_pose": lambda s, d=step: project(points, centre + s * d, turn, lens),
            "turned": lambda s, d=step: project(
                points, centre, rotation_from_vector(s * d) @ turn, lens
            ),
        }
        for what, pixels in moves.items():
            numeric = (pixels(1) - pixels(-1)) / (2 * h)
            column = (
                found.by_pose[:, :, 3 + k] if what == "turned" else getattr(found, what)[:, :, k]
            )
            assert column == pytest.approx(numeric, abs=1e-5, rel=1e-6)
    seen = (points - centre) @ turn.T
    inner = interior_derivatives(seen[:, :2] / seen[:, 2:], lens)
    assert found.by_interior == pytest.approx(inner, abs=1e-12)
