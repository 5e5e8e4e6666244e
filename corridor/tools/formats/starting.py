"""A reconstruction that starts from the photographs' own positions and attitudes.

Where pictures are bent (a slow shutter) a model that grows from picture to picture bends too. Here
all pictures have their place from the beginning: points are intersected with a wide limit, the
poses adjusted with the positions held to their sigma, and the limit is made narrower.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from corridor.core.geometry import rotation_from_roll_pitch_yaw
from corridor.core.gnss import Local
from corridor.core.output import silent
from corridor.core.photographs import Metadata
from corridor.tools.formats.heading import headings

# Limits of reprojection, as parts of the focal length: attitudes are good to some degrees.
_LIMITS = (0.13, 0.045, 0.018, 0.009, 0.007)
_LENS_FROM = 0.02
_SIGMA_M = (3.0, 3.0, 6.0)


def can_start(photos: list[Metadata]) -> bool:
    """Whether every photograph states position and attitude, and to where its yaw counts."""
    wanted = ("lat_deg", "height", "yaw", "pitch", "roll")
    if not all(getattr(photo, name) is not None for photo in photos for name in wanted):
        return False
    return len(photos) > 0 and bool(np.isfinite(rotations_of(photos)).all())


def rotations_of(photos: list[Metadata]) -> np.ndarray:
    """(n, 3, 3) of `rotation_of`; NaN where a photograph states no attitude that can be used."""
    out = np.full((len(photos), 3, 3), np.nan)
    for row, yaw in enumerate(headings(photos).yaw):
        photo = photos[row]
        if np.isfinite(yaw) and None not in (photo.pitch, photo.roll):
            out[row] = rotation_of(photo, yaw - 180 * (abs(photo.roll) > 90))
    return out


def rotation_of(photo: Metadata, yaw: float) -> np.ndarray:
    """(3, 3) world (east, north, up) to camera, by yaw (degrees from north), pitch, roll.

    DJI's are the gimbal's, which looks forward at pitch 0; others are the body's, whose camera
    looks down.
    """
    gimbal = "GimbalYawDegree" in photo.tags or "dji" in photo.make.lower()
    angles = [[photo.roll, photo.pitch, yaw]]
    return rotation_from_roll_pitch_yaw(angles, "camera" if gimbal else "body")[0]


def from_attitudes(
    pycolmap,
    database: Path,
    folder: Path,
    photos: dict[str, Metadata],
    say: Callable[..., None] = silent,
):
    """The model of all photographs, in metres about their middle. photos: by name in `database`."""
    spots = np.array([[p.lon_deg, p.lat_deg, p.height] for p in photos.values()])
    lon, lat, height = np.median(spots, axis=0)
    places = Local(float(lat), float(lon), float(height)).from_geographic(spots)
    centre = dict(zip(photos, places, strict=True))
    with pycolmap.Database.open(database) as base:
        cache = pycolmap.DatabaseCache.create(base, pycolmap.DatabaseCacheOptions())
    model = pycolmap.Reconstruction()
    model.load(cache)
    priors, turns = [], dict(zip(photos, rotations_of(list(photos.values())), strict=True))
    for image in model.images.values():
        turn, at = turns[image.name], centre[image.name]
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), -turn @ at)
        image.frame.set_cam_from_world(image.camera_id, pose)
        model.register_frame(image.frame_id)
        sigma = photos[image.name].sigma or _SIGMA_M
        priors.append(
            pycolmap.PosePrior(
                pose_prior_id=len(priors) + 1, corr_data_id=image.data_id, position=at,
                position_covariance=np.diag(np.square(sigma)),
                coordinate_system=pycolmap.PosePriorCoordinateSystem.CARTESIAN,
            )
        )  # fmt: skip
    focal = min(camera.mean_focal_length() for camera in model.cameras.values())
    for done, limit in enumerate(_LIMITS, 1):
        say(f"adjusting from positions and attitudes: {done} of {len(_LIMITS)}")
        model = _intersected(pycolmap, model, database, folder, limit, focal)
        _adjusted(pycolmap, model, priors, limit, focal)
    return model


def _intersected(pycolmap, model, database, folder, limit, focal):
    """The model with its points made anew from its poses, within a limit (of the focal length)."""
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.random_seed = 0
    options.mapper.filter_max_reproj_error = limit * focal
    points = options.triangulation
    angle = max(2.0, 1.5 * float(np.degrees(limit)))
    points.create_max_angle_error = points.continue_max_angle_error = angle
    points.re_max_angle_error = max(5.0, angle)
    points.merge_max_reproj_error = points.complete_max_reproj_error = limit * focal
    with tempfile.TemporaryDirectory(prefix="corridor-") as work:
        return pycolmap.triangulate_points(model, database, folder, work, True, options, False)


def _adjusted(pycolmap, model, priors, limit, focal):
    """Adjust poses and points in place; positions are held to their sigma, the focal length is."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = False
    options.refine_extra_params = limit < _LENS_FROM
    options.ceres.loss_function_type = pycolmap.LossFunctionType.SOFT_L1
    options.ceres.loss_function_scale = max(limit * focal / 8, 1.0)
    images = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        images.add_image(image)
    held = pycolmap.PosePriorBundleAdjustmentOptions()
    pycolmap.create_pose_prior_bundle_adjuster(options, held, images, priors, model).solve()
