"""Fisheyes of other programs: their own formula, written here once more, against ours."""

import json

import numpy as np
import pytest

import corridor
from corridor.core.camera import Camera, project_rays, undistort
from corridor.core.errors import InputError
from corridor.core.textfile import Xml
from corridor.tools.formats import export_project, prove, read_project
from corridor.tools.formats.cameras import NoModel
from corridor.tools.formats.programs.colmap.cameras import camera_of as colmap_camera
from corridor.tools.formats.programs.metashape import _camera as metashape_camera
from corridor.tools.formats.programs.nerfstudio import read as read_nerfstudio
from corridor.tools.formats.programs.opensfm import camera_of as opensfm_camera
from corridor.tools.formats.programs.sfm_data import _AliceVision, _OpenMvg
from corridor.tools.formats.textfile import Json

from .conftest import exact_block
from .test_round_trips import same_cameras, same_observations, same_poses

SIZE = (4000, 3000)
RAYS = np.random.default_rng(4).uniform(-1.6, 1.6, (200, 2))
K = (0.03, -0.011, 0.004, -0.0012)


def by_angle(rays, k, p1=0.0, p2=0.0, radius=lambda theta: theta):
    """OpenCV's fisheye at unit focal length; p1, p2 as OpenCV has them, at the same place."""
    r = np.hypot(*rays.T)
    x, y = rays.T * (radius(np.arctan(r)) / r)
    square = x * x + y * y
    d = 1 + sum(value * square ** (n + 1) for n, value in enumerate(k))
    return np.stack(
        [
            x * d + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * d + 2 * p2 * x * y + p1 * (square + 2 * y * y),
        ],
        axis=1,
    )


def agree(camera, pixels, within=1e-9):
    assert camera.fisheye
    assert np.abs(project_rays(RAYS, camera.interior) - pixels).max() < within


@pytest.fixture(scope="module")
def wide():
    """An exact block of an action camera."""
    terms = {f"k{n + 1}": v for n, v in enumerate(K)}
    return exact_block(f=1750.0, model="fisheye", b1=1.5e-3, **terms)


class TestRead:
    @pytest.mark.parametrize(
        "model, params, k",
        [
            ("OPENCV_FISHEYE", [1761.0, 1750.0, 2004.0, 1493.0, *K], K),
            ("SIMPLE_RADIAL_FISHEYE", [1750.0, 2004.0, 1493.0, 0.03], (0.03,)),
            ("RADIAL_FISHEYE", [1750.0, 2004.0, 1493.0, 0.03, -0.01], (0.03, -0.01)),
            ("SIMPLE_FISHEYE", [1750.0, 2004.0, 1493.0], ()),
        ],
    )
    def test_colmap_whose_first_pixel_is_at_a_half(self, model, params, k):
        fx = params[0] if model == "OPENCV_FISHEYE" else 1750.0
        theirs = [2004.0, 1493.0] + np.array([fx, 1750.0]) * by_angle(RAYS, k)
        agree(colmap_camera("1", model, *SIZE, params, []), theirs - 0.5)

    def test_colmap_itself_with_two_focal_lengths(self):
        pycolmap = pytest.importorskip("pycolmap")
        params = [1761.0, 1750.0, 2004.0, 1493.0, *K]
        theirs = pycolmap.Camera(
            model="OPENCV_FISHEYE", width=SIZE[0], height=SIZE[1], params=params
        ).img_from_cam(np.column_stack([RAYS, np.ones(len(RAYS))]))
        agree(colmap_camera("1", "OPENCV_FISHEYE", *SIZE, params, []), theirs - 0.5)

    @pytest.mark.parametrize("kind, count", [("fisheye", 2), ("fisheye_opencv", 4)])
    def test_opensfm_in_shares_of_the_long_side(self, kind, count):
        focal = {"focal": 0.4} if kind == "fisheye" else {"focal_x": 0.4, "focal_y": 0.4}
        table = {"projection_type": kind, "width": 4000, "height": 3000, **focal}
        table |= {f"k{n + 1}": value for n, value in enumerate(K[:count])}
        camera = opensfm_camera("c", Json(table, "c"), [])
        agree(camera, [1999.5, 1499.5] + 1600.0 * by_angle(RAYS, K[:count]))

    def test_opensfm_with_six_terms_and_a_decentred_lens(self):
        table = {"projection_type": "fisheye62", "width": 4000, "height": 3000, "focal_x": 0.4}
        k = (*K, 3e-4, -1e-4)
        table |= {"focal_y": 0.4, "c_x": 0.001, "c_y": -0.002, "p1": 4e-4, "p2": -3e-4}
        table |= {f"k{n + 1}": value for n, value in enumerate(k)}
        theirs = [2003.5, 1491.5] + 1600.0 * by_angle(RAYS, k, 4e-4, -3e-4)
        agree(opensfm_camera("c", Json(table, "c"), []), theirs)

    @pytest.mark.parametrize("kind", ["fisheye", "equidistant_fisheye", "equisolid_fisheye"])
    def test_metashape_whose_equisolid_lens_stands_within_a_tenth(self, kind, tmp_path):
        file, notes = tmp_path / "s.xml", []
        terms = "".join(f"<k{n + 1}>{v}</k{n + 1}>" for n, v in enumerate(K))
        file.write_text(
            f'<sensor id="0" label="s" type="{kind}"><resolution width="4000" height="3000"/>'
            f'<calibration type="{kind}" class="adjusted"><resolution width="4000" height="3000"/>'
            f"<f>1750</f><cx>4</cx><cy>-7</cy>{terms}<p1>4e-4</p1><p2>-3e-4</p2><b1>3</b1>"
            "<b2>-2</b2></calibration>"
            "</sensor>"
        )
        camera = metashape_camera(Xml.read(file), "s", notes)
        solid = (lambda t: 2 * np.sin(t / 2)) if kind.startswith("equisolid") else (lambda t: t)
        # Their p1, p2 are OpenCV's p2, p1.
        bent = by_angle(RAYS, K, -3e-4, 4e-4, solid)
        theirs = [2003.5, 1492.5] + 1750.0 * bent
        theirs[:, 0] += 3.0 * bent[:, 0] - 2.0 * bent[:, 1]
        inside = ((theirs > 0) & (theirs < SIZE)).all(axis=1)
        off = np.abs(project_rays(RAYS, camera.interior) - theirs)[inside].max()
        assert camera.fisheye and off < (0.1 if kind.startswith("equisolid") else 1e-9)
        assert bool(notes) == kind.startswith("equisolid")

    def test_openmvg_and_alicevision(self):
        data = {"width": 4000, "height": 3000, "focal_length": 1750.0}
        data |= {"principal_point": [2003.5, 1492.5], "fisheye": list(K)}
        whole = Json({"sfm_data_version": "0.3"}, "file")
        entry = Json({"polymorphic_name": "fisheye", "ptr_wrapper": {"data": data}}, "file")
        theirs = [2003.5, 1492.5] + 1750.0 * by_angle(RAYS, K)
        agree(_OpenMvg(whole).camera("camera_1", {"1": entry}), theirs)
        row = {"width": "4000", "height": "3000", "type": "fisheye4", "pxFocalLength": "1750"}
        row |= {"principalPoint": ["2003.5", "1492.5"], "distortionParams": [str(v) for v in K]}
        whole = Json({"version": ["1", "0", "0"]}, "file")
        agree(_AliceVision(whole).camera("camera_1", {"1": Json(row, "file")}), theirs)

    def test_nerfstudio_where_it_says_so(self, tmp_path):
        whole = {"w": 4000, "h": 3000, "fl_x": 1750.0, "fl_y": 1750.0, "cx": 2004.0, "cy": 1493.0}
        whole |= {f"k{n + 1}": value for n, value in enumerate(K)}
        whole["frames"] = [{"file_path": "a.jpg", "transform_matrix": np.eye(4).tolist()}]
        file = tmp_path / "transforms.json"
        file.write_text(json.dumps(whole | {"camera_model": "OPENCV_FISHEYE"}))
        (camera,) = read_nerfstudio(file).block.cameras.values()
        agree(camera, [2003.5, 1492.5] + 1750.0 * by_angle(RAYS, K))
        file.write_text(json.dumps(whole))
        with pytest.raises(NoModel, match="has k4, the model of a fisheye"):
            read_nerfstudio(file)


class TestWrite:
    @pytest.mark.parametrize("form", ["colmap", "colmap-text", "opensfm"])
    def test_what_went_out_comes_back_and_is_proved(self, form, wide, tmp_path):
        export_project(wide, form, tmp_path / "out")
        project = read_project(tmp_path / "out")
        same_observations(wide, project.block)
        same_poses(wide, project.block)
        same_cameras(wide, project.block)
        assert next(iter(project.block.cameras.values())).fisheye
        assert prove(project).verdict == "proved"

    def test_an_imported_model_adjusts_and_goes_out_again(self, wide, tmp_path):
        export_project(wide, "colmap", tmp_path / "in")
        block = read_project(tmp_path / "in").block
        found = corridor.adjust(block, camera="f,cx,cy,k1,k2,k3,k4,b1", lever_arm="fixed")
        assert found.converged and found.statistics["tie"]["rms"] < 1e-6
        export_project(found.block, "colmap-text", tmp_path / "out")
        row = (tmp_path / "out" / "cameras.txt").read_text().splitlines()[-1].split()
        assert row[1] == "OPENCV_FISHEYE"
        assert float(row[4]) == pytest.approx(1750.0 * 1.0015, abs=1e-6)

    def test_opensfm_with_decentring_takes_the_longer_kind(self, tmp_path):
        block = exact_block(f=1750.0, model="fisheye", k1=0.02, p1=4e-4, p2=-3e-4)
        export_project(block, "opensfm", tmp_path / "out")
        same_cameras(block, read_project(tmp_path / "out").block)
        whole = json.loads((tmp_path / "out" / "reconstruction.json").read_text())
        assert next(iter(whole[0]["cameras"].values()))["projection_type"] == "fisheye62"

    def test_metashape_writes_its_fisheye(self, wide, tmp_path):
        export_project(wide, "metashape", tmp_path / "out")
        text = (tmp_path / "out" / "cameras.xml").read_text()
        assert 'type="fisheye"' in text and 'type="frame"' not in text
        assert "<projection>fisheye" in (tmp_path / "out" / "calibration_0.xml").read_text()

    @pytest.mark.parametrize("form", ["bundler", "micmac"])
    def test_a_program_without_such_a_lens_is_refused_with_those_that_have_one(
        self, form, wide, tmp_path
    ):
        for options in ({}, {"corrected": True}, {"lossy": True}):
            with pytest.raises(InputError, match=f"{form} has no fisheye lens, and camera P1 is"):
                export_project(wide, form, tmp_path / "out", **options)

    def test_what_colmap_cannot_hold_of_it_is_corrected(self, tmp_path):
        block = exact_block(f=1750.0, model="fisheye", k1=0.02, p1=4e-4, k5=1e-4)
        with pytest.raises(InputError, match="cannot hold p1, k5 of camera P1"):
            export_project(block, "colmap", tmp_path / "out")
        export_project(block, "colmap", tmp_path / "out", corrected=True)
        assert prove(read_project(tmp_path / "out")).verdict == "proved"


def test_a_ray_stays_where_it_was_when_it_moves_to_another_lens():
    """What `--corrected` does: the same rays in a fisheye with fewer terms."""
    one = Camera.from_table(
        "a", {"width": 4000, "height": 3000, "f": 1750.0, "model": "fisheye", "p1": 1e-3}
    )
    pixels = project_rays(RAYS, one.interior)
    assert undistort(pixels, one.interior) == pytest.approx(RAYS, abs=1e-10)
