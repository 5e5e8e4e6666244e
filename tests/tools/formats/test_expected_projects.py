"""Every real project: counts, centres, rotations, cameras and residuals as others found them.

Expected numbers: `expected.json` beside each project, made by an independent reader and proved by
reprojection. Two of its counts are of its own reader and not of the files: they stand below.
"""

import json

import numpy as np
import pytest

from corridor.core.camera import INTERIOR, undistort
from corridor.core.camera import project as project_points
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import Local, convert
from corridor.tools.formats import prove, read_project
from corridor.tools.formats.proof import Residuals
from corridor.tools.formats.rows import rows_of

PROJECTS = [
    "colmap_made/text",
    "colmap_made/binary",
    "colmap_made/text_before_rigs",
    "colmap_sceaux",
    "opensfm_berlin",
    "opensfm_made_brown",
    "odm_albay",
    "metashape_made",
    "metashape_markers",
    "metashape_forest",
    "photoscan_strasbourg",
    "micmac_saisies",
    "micmac_fraser",
    "pix4d_p1",
    "bundler_balbianello",
    "nvm_sceaux",
    "bal_dubrovnik/dubrovnik-3-7-pre.txt",
    "bal_dubrovnik/balbianello_as_bal.txt",
    "photomodeler_strasbourg",
]


def expected(folder, name):
    home = folder / name.split("/")[0]
    found = json.loads((home / "expected.json").read_text())
    return found.get(name.split("/")[-1], found)


@pytest.fixture(scope="module")
def projects(real_data):
    known = {}

    def of(name):
        if name not in known:
            known[name] = read_project(real_data / "interchange" / name)
        return known[name], expected(real_data / "interchange", name)

    return of


@pytest.mark.parametrize("name", PROJECTS)
class TestEveryProject:
    def test_images_stand_where_and_look_where_they_should(self, name, projects):
        project, known = projects(name)
        block = project.block
        images = block.images.set_index("image")
        for k, row in enumerate(known["images"]):
            image = row["image"]
            if "image_id" in row and image not in images.index:
                # expected.json cuts names at their first blank.
                image = next(n for n in images.index if n.startswith(image + " ") and n[-6:-4] ==
                             f"{row['image_id']:02d}")  # fmt: skip
            pose = images.loc[image, ["x", "y", "z", "qw", "qx", "qy", "qz"]].to_numpy(float)
            centre = pose[:3] + block.offset
            if "ecef_centre" in row:
                local = block.extra["local_frame"]
                place = Local(local["lat_deg"], local["lon_deg"], local["height"])
                ecef = convert(place.to_geographic(centre[None]), "EPSG:4979", "EPSG:4978")[0]
                assert np.abs(ecef - row["ecef_centre"]).max() < 1e-5, k
                # expected.json counts heights from 1850 m, with the same axes.
                assert np.abs(centre - [0, 0, 1850] - row["centre"]).max() < 1e-5
            else:
                # expected.json rounds to 12 digits.
                size = np.abs(row["centre"]).max()
                assert np.abs(centre - row["centre"]).max() < 1e-6 + 1e-11 * size, image
            turn = rotation_from_quaternion(np.array([pose[3:], row["q"]]))
            relative = turn[0] @ turn[1].T
            vector = np.array([relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0],
                               relative[1, 0] - relative[0, 1]]) / 2  # fmt: skip
            assert np.linalg.norm(vector) < 1e-7 and np.trace(relative) > 2.9, image

    def test_cameras_are_those_of_the_file_in_our_parameters(self, name, projects):
        project, known = projects(name)
        cameras = project.block.cameras
        found = known.get("cameras", {})
        for label, row in found.items():
            camera = cameras.get(label)
            if camera is None and label.isdecimal() and name == "metashape_markers":
                camera = list(cameras.values())[int(label)]
            if camera is None:
                assert len(cameras) == len(found) == 1
                camera = next(iter(cameras.values()))
            told = {
                key: row[key] for key in ("f", "cx", "cy", "p1", "p2", "b1", "b2") if key in row
            }
            told |= {f"k{n}": value for n, value in enumerate(row["k"], start=1)}
            for key in INTERIOR:
                assert camera[key] == pytest.approx(told.get(key, 0.0), rel=1e-9, abs=1e-10), key
            if "width" in row:
                assert (camera.width, camera.height) == (row["width"], row["height"])

    def test_counts_are_right(self, name, projects):
        project, known = projects(name)
        block, counts = project.block, known["counts"]
        if name.endswith(("dubrovnik-3-7-pre.txt", "balbianello_as_bal.txt")):
            counts = counts | {"images": counts["cameras"]}
        images = counts.get("images", counts.get("shots", counts.get("cameras")))
        if name == "micmac_fraser":
            # Img0907 names the NIKON's calibration, not the fish-eye's, and its own ten pairs
            # prove it to 1e-11 px: it is imported.
            images = 2
        if name == "metashape_forest":
            images = counts["cameras_in_file"]
            assert block.images["x"].notna().sum() == counts["with_transform"]
        assert len(block.images) == images
        observations = len(block.tie_points) + len(block.marks)
        left_out = sum(int(s.split()[0]) for s in project.warnings if "second time" in s)
        for key in ("observations", "tie_observations", "marks", "marker_projections"):
            if key in counts and name not in ("opensfm_berlin", "photoscan_strasbourg"):
                assert observations + left_out == counts[key]
        if name == "opensfm_berlin":
            assert (
                len(block.tie_points) == counts["observations_of_reconstructed_points"]
                if ("observations_of_reconstructed_points" in counts)
                else len(block.tie_points) == 3082
            )
        if name == "photoscan_strasbourg":
            assert len(block.tie_points) == counts["tie_observations_with_a_point"]
            assert len(block.marks) == counts["marker_projections"]
        for key, table in (("ground_points", block.ground), ("gcps_in_list", block.ground)):
            if key in counts:
                assert len(table) == counts[key]
        if "points" in counts:
            # PhotoModeler: 17 points; the 22 of expected.json count its five photo lines too.
            points = 17 if name == "photomodeler_strasbourg" else counts["points"]
            assert len(block.points) == points

    def test_residuals_are_as_expected_within_two_per_cent(self, name, projects):
        project, known = projects(name)
        found = _residuals(project, name)
        for key, length in found.items():
            told = known[key] if key in known else known["residuals_px"]
            told = told[key] if key in told else told.get("all", told)
            mine = Residuals.of(length)
            # Exact projects have the rounding of their numbers.
            assert mine.rms == pytest.approx(told["rms_xy"], rel=0.02, abs=2e-9), key
            assert mine.median == pytest.approx(told["median_length"], rel=0.02, abs=2e-9), key


def _residuals(project, name):
    if name in ("odm_albay", "metashape_forest", "micmac_fraser"):
        return {}
    rows = rows_of(project.block, complete=False)
    residual = rows.residuals()
    length = np.linalg.norm(residual, axis=1)
    tie = np.arange(len(length)) < len(project.block.tie_points)
    if name == "colmap_sceaux":
        return {}  # a second observation of a point in an image was left out: see its own test
    if name == "nvm_sceaux":
        image = rows.image
        seen = np.einsum("nij,nj->ni", rows.rotation[image],
                         rows.positions[rows.point] - rows.centre[image])  # fmt: skip
        away = undistort(rows.pixels, rows.interior, image) - seen[:, :2] / seen[:, 2:]
        away = np.linalg.norm(away, axis=1) * rows.interior[image, 0]
        return {"residuals_px_in_undistorted_coordinates": away}
    if name == "opensfm_berlin":
        return {"residuals_px": length[tie]}
    if name == "pix4d_p1":
        rays = np.bincount(rows.point)[rows.point]
        return {"all": length, "observations_of_points_in_three_or_more": length[rays > 2]}
    if name == "metashape_made":
        return {"with_design_b1_b2": length}
    if name == "metashape_markers":
        return {}  # unadjusted poses: see its own test
    if name == "photoscan_strasbourg":
        return {"tie_points": length[tie], "markers_against_their_reference": length[~tie]}
    if name == "micmac_saisies":
        return {}
    return {"residuals_px": length}


def test_a_pair_seen_twice_in_one_image_is_told_and_the_rest_keeps_its_residual(projects):
    """colmap_sceaux: 91 of 6708 observations; the residual of all is 0.82 px RMS."""
    project, known = projects("colmap_sceaux")
    assert any(s.startswith("91 of 6708 observations") for s in project.warnings)
    assert prove(project).main.rms == pytest.approx(
        known["residuals_px"]["all"]["rms_xy"], rel=0.02
    )


def test_micmac_pairs_come_back_and_marks_fit_the_ground_points(projects):
    """The files' own pairs under Verif; marks against ground points 1.43 px RMS."""
    project, known = projects("micmac_saisies")
    proof = prove(project)
    assert proof.by_kind["pairs of the project itself"].rms < 1e-10
    block = project.block
    given = block.marks["point"].isin(block.ground["point"]).to_numpy()
    length = np.linalg.norm(rows_of(block, complete=False).residuals(), axis=1)
    told = known["marks_px"]["against_ground_points"]
    assert given.sum() == told["observations"]
    assert Residuals.of(length[given]).rms == pytest.approx(told["rms_xy"], rel=0.02)
    project, _ = projects("micmac_fraser")
    assert prove(project).by_kind["pairs of the project itself"].rms < 1e-10


def test_markers_from_measured_poses_leave_what_such_poses_leave(projects):
    """metashape_markers: unadjusted poses, median 8.6 px over 339 projections.

    Rays that miss each other by so much meet where the estimator says; expected.json took the
    linear one.
    """
    project, known = projects("metashape_markers")
    told = known["residuals_px"]["markers_in_three_or_more_against_own_intersection"]
    proof = prove(project)
    assert proof.main.count == told["observations"] and proof.verdict == "refused"
    rows = rows_of(project.block, complete=False)
    posed = np.isfinite(rows.centre).all(axis=1)[rows.image]
    image, point, pixels = rows.image[posed], rows.point[posed], rows.pixels[posed]
    rays = undistort(pixels, rows.interior, image)
    places = np.full(rows.positions.shape, np.nan)
    for k in np.unique(point):
        mine = np.flatnonzero(point == k)
        turn, centre = rows.rotation[image[mine]], rows.centre[image[mine]]
        matrix = np.concatenate([turn, -np.einsum("nij,nj->ni", turn, centre)[:, :, None]], axis=2)
        linear = rays[mine][:, :, None] * matrix[:, 2:] - matrix[:, :2]
        solution = np.linalg.svd(linear.reshape(-1, 4))[2][-1]
        places[k] = solution[:3] / solution[3]
    modelled = project_points(places[point], rows.centre[image], rows.rotation[image],
                              rows.interior, image)  # fmt: skip
    found = Residuals.of(np.linalg.norm(pixels - modelled, axis=1))
    assert found.median == pytest.approx(told["median_length"], rel=0.02)


def test_mmvii_says_the_same_as_micmac_one(projects, real_data):
    one, _ = projects("micmac_saisies")
    two = read_project(real_data / "interchange" / "micmac_saisies" / "MMVII-PhgrProj")
    pose = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    assert (
        np.abs(one.block.images[pose].to_numpy() - two.block.images[pose].to_numpy()).max() < 1e-9
    )
    assert len(two.block.marks) == len(one.block.marks) == 19
    assert len(two.block.ground) == len(one.block.ground) == 9


def test_a_calibration_from_image_to_ray_gives_the_rays_it_states(real_data):
    """micmac_fraser, DRadFinalePentax28mm.xml: four pairs of pixel and ray in expected.json."""
    from corridor.tools.formats.programs.micmac import _calibration

    home = real_data / "interchange" / "micmac_fraser"
    notes = []
    camera = _calibration(home / "Calibs" / "DRadFinalePentax28mm.xml", notes)
    known = json.loads((home / "expected.json").read_text())["camera_to_world_direction"]
    pairs = known["Calibs/DRadFinalePentax28mm.xml"]["pairs"]
    pixels = np.array([pair["image_px"] for pair in pairs])
    rays = undistort(pixels, camera.interior)
    told = np.array([pair["u_v"] for pair in pairs])
    assert np.abs(rays - told).max() * camera["f"] < 0.01
    assert any("image-to-ray" in note for note in notes)


def test_a_fish_eye_is_named_and_the_rest_imported(real_data, tmp_path):
    """micmac_fraser with Img0907 bound to its fish-eye calibration."""
    import shutil

    home = tmp_path / "Ori-Fish"
    shutil.copytree(real_data / "interchange" / "micmac_fraser" / "Ori-MMV1", home)
    for file in home.iterdir():
        file.chmod(0o644)
    file = home / "Orientation-Img0907.tif.xml"
    text = file.read_text().replace(
        "AutoCal_Foc-60000_Cam-NIKON_D810", "AutoCal_Foc-11500_Cam-imx477imx477-1"
    )
    file.write_text(text)
    project = read_project(home)
    assert list(project.block.images["image"]) == ["_DSC8385.tif"]
    assert any("eModele_FishEye_10_5_5" in s and "Img0907.tif" in s for s in project.warnings)
