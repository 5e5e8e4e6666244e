"""Cameras: compared by eq. 6.4, warmed by a model, resected standing still."""

from dataclasses import replace

import numpy as np
import pytest
from kit.static import resect, static_block
from walls import camlight

from corridor.core.camera import Camera, project_rays, undistort
from corridor.core.errors import InputError
from corridor.core.geometry import rotation_from_vector
from corridor.core.simulation import CAMLIGHT, add_noise
from corridor.tools.thermal import camera_at, compare_cameras, simple_model, uncorrect


class TestComparison:
    def test_a_change_of_f_by_072_px_is_the_published_difference(self):
        """Issue 9, must show 7; Zhou 2019, section 6.5.2.1: 0.23 px mean, 0.33 px at the border."""
        plain = Camera.from_table("a", {"width": 5120, "height": 3840, "f": 5489.0})
        found = compare_cameras(plain, plain.with_values(f=5489.72))
        assert found.mean == pytest.approx(0.23, abs=0.01)
        assert found.side == pytest.approx(0.335, abs=0.01)
        # By hand, where no rotation helps: 0.72 / 5489 times 2559.5.
        assert found.side == pytest.approx(0.72 / 5489 * 2559.5, abs=1e-4)

    def test_a_camera_against_itself_is_nothing(self):
        """Issue 9, must show 7: below 1e-9."""
        assert compare_cameras(CAMLIGHT, CAMLIGHT).largest < 1e-9

    def test_a_rotation_is_taken_out(self):
        """The principal point moved by 0.27 px is nearly a rotation by 0.27 / f."""
        found = compare_cameras(CAMLIGHT, CAMLIGHT.with_values(cy=CAMLIGHT["cy"] + 0.27))
        assert found.largest < 0.27 / 4
        assert np.abs(found.rotation).max() == pytest.approx(0.27 / 5489, rel=0.1)

    def test_no_other_rotation_is_better(self):
        other = camera_at(CAMLIGHT, camlight(), 34.0)
        found = compare_cameras(CAMLIGHT, other)
        pixels = np.column_stack([found.x, found.y])
        rays = np.column_stack([undistort(pixels, CAMLIGHT.interior), np.ones(len(pixels))])
        for vector in 1e-6 * np.vstack([np.eye(3), -np.eye(3)]):
            turned = rays @ rotation_from_vector(found.rotation + vector).T
            off = project_rays(turned[:, :2] / turned[:, 2:], other.interior) - pixels
            assert np.mean(np.sum(off**2, axis=1)) > found.squared

    def test_another_size_is_refused(self):
        with pytest.raises(InputError, match="one size"):
            compare_cameras(CAMLIGHT, replace(CAMLIGHT, width=1000))


class TestWarmCamera:
    def test_it_sees_what_the_model_says(self):
        model = camlight()
        warm = camera_at(CAMLIGHT, model, 40.0)
        x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 5119, 9), np.linspace(0, 3839, 7)))
        pixels = np.column_stack([x, y])
        seen = project_rays(undistort(pixels, CAMLIGHT.interior), warm.interior)
        moved = pixels + np.stack(model.displacement(x, y, 40.0), axis=1)
        # Fraser's ten hold it but for a principal point that is not in the picture's middle.
        assert np.abs(seen - moved).max() < 0.005

    def test_a_scale_alone_is_a_focal_length(self):
        """13.7 ppm of 5489 px: 0.0752 px/C."""
        plain = Camera.from_table("a", {"width": 5120, "height": 3840, "f": 5489.0})
        warm = camera_at(plain, simple_model(5120, 3840), 34.0)
        assert warm["f"] - plain["f"] == pytest.approx(0.752, abs=0.001)


@pytest.fixture(scope="module")
def warming():
    model = simple_model(5120, 3840, 30.6, scale=(13.7e-6,), shift=((0.05, -0.03),))
    return uncorrect(static_block(), model)[0]


class TestResection:
    def test_slopes_are_known_to_a_few_thousandths_of_a_pixel_a_degree(self, warming):
        """Issue 9, must show 6: at most 0.002 (f) and 0.0006 px/C (cx) at 0.1 px."""
        found = resect(add_noise(warming, mark_px=0.1, seed=1)).slopes.set_index("parameter")
        assert found["sigma"]["f"] <= 0.002
        assert found["sigma"]["cx"] <= 0.0006 and found["sigma"]["cy"] <= 0.0006
        for name, true in (("f", 0.0752), ("cx", 0.05), ("cy", -0.03)):
            assert abs(found["slope"][name] - true) < 4 * found["sigma"][name]

    @pytest.mark.slow
    def test_the_formal_sigma_is_the_empirical_one(self, warming):
        """Issue 9, must show 6: within 15 %, over draws."""
        slopes, formal = [], None
        for seed in range(40):
            table = resect(add_noise(warming, mark_px=0.1, seed=seed), "stated").slopes
            slopes.append(table["slope"])
            formal = table["sigma"].to_numpy()
            assert table["empirical"].to_numpy() == pytest.approx(formal, rel=0.15)
        spread = np.std(slopes, axis=0, ddof=1)
        # Forty draws know a standard deviation to 11 %.
        assert spread == pytest.approx(formal, rel=0.4)

    def test_with_the_pose_free_hardly_anything_is_left(self, warming):
        """Issue 9: 97 to 98 % correlated with the pose."""
        free = resect(add_noise(warming, mark_px=0.1, seed=1), "free")
        held = resect(add_noise(warming, mark_px=0.1, seed=1), "held")
        assert all(value > 0.97 for value in free.correlation.values())
        assert (free.slopes["sigma"] > 5 * held.slopes["sigma"]).all()

    def test_without_noise_it_is_exact(self, warming):
        slopes = resect(warming, "stated").slopes["slope"]
        assert slopes[0] == pytest.approx(5489 * 13.7e-6, rel=1e-3)

    def test_too_few_points_are_named(self, warming):
        block = warming.copy()
        block.marks = block.marks[3:].groupby("image", observed=False).head(20).iloc[18:]
        with pytest.raises(InputError, match="S001"):
            resect(block)
