"""attitudes.csv: how the camera, or the body that carries it, stood at each exposure.

Each row has one of three forms; all are rotations from world to camera here. `[attitudes]` of
block.toml says what roll, pitch and yaw are of: `frame = "body"` (an aircraft, which carries the
camera looking down, the top of the picture forward) or `frame = "camera"` (a gimbal: a pitch of
-90 degrees looks down). Yaw counts from the world's y over x. omega, phi, kappa turn the camera
(y up, z back) into the world; qw, qx, qy, qz are as in images.csv.

Standard deviations are of small turns about level axes: sroll about the horizontal of the heading,
spitch about the horizontal to the right of it, syaw about the vertical, degrees.
"""

import numpy as np

from corridor.core.block.tables import ANGLES, QUATERNION
from corridor.core.errors import InputError
from corridor.core.geometry import (
    angles_from_rotation,
    quaternion_from_rotation,
    roll_pitch_yaw_from_rotation,
    rotation_from_angles,
    rotation_from_quaternion,
    rotation_from_roll_pitch_yaw,
)

FRAMES = ("body", "camera")
_ROLLED, _AERIAL = ANGLES
_BACK = np.diag([1.0, -1.0, -1.0])  # camera y up, z back


def form_of(block) -> tuple[str, ...]:
    """The columns that hold the attitudes. Raises InputError where none or several forms do."""
    table = block.attitudes
    forms = [form for form in (*ANGLES, QUATERNION) if set(form) <= set(table)]
    if len(forms) != 1:
        options = "; or ".join(", ".join(form) for form in (*ANGLES, QUATERNION))
        raise InputError(f"attitudes.csv has {'several forms' if forms else 'no whole form'} of "
                         f"an attitude (it has {', '.join(table)}): keep one of {options}, in "
                         "degrees")  # fmt: skip
    return forms[0]


def frame_of(block) -> str:
    """What roll, pitch and yaw are of. Raises InputError where block.toml does not say it."""
    frame = block.extra.get("attitudes", {}).get("frame")
    if frame not in FRAMES:
        told = "is not stated" if frame is None else f"= {frame!r} is unknown"
        raise InputError(
            f"block.toml: frame {told} in [attitudes], which says of what attitudes.csv gives "
            'roll, pitch, yaw: write frame = "body" (an aircraft, the camera looks down) or '
            'frame = "camera" (a gimbal, a pitch of -90 looks down)'
        )
    return frame


def check_attitudes(block) -> tuple[str, ...]:
    """The form, after its frame was looked for. Raises InputError."""
    given = block.extra.get("attitudes", {})
    if not isinstance(given, dict) or not isinstance(given.get("calibrated", False), bool):
        raise InputError(
            "block.toml: [attitudes] is a table with frame, and calibrated = true or false "
            "without quotes"
        )
    form = form_of(block)
    if form == _ROLLED:
        frame_of(block)
    return form


def rotations(block) -> np.ndarray:
    """Rotations (n, 3, 3), world to camera, of the rows of attitudes.csv; NaN where unknown."""
    if not len(block.attitudes):
        return np.zeros((0, 3, 3))
    form = form_of(block)
    values = block.numbers("attitudes", *form)
    if form == QUATERNION:
        return rotation_from_quaternion(values)
    known = np.isfinite(values).all(axis=1)
    out = np.full((len(values), 3, 3), np.nan)
    if form == _ROLLED:
        out[known] = rotation_from_roll_pitch_yaw(values[known], frame_of(block))
    else:
        out[known] = [_BACK @ rotation_from_angles(*row).T for row in values[known]]
    return out


def put_rotations(block, turned: np.ndarray) -> None:
    """Write rotations (n, 3, 3) in the form that attitudes.csv has."""
    form = form_of(block)
    known = np.isfinite(turned).all(axis=(1, 2))
    values = block.numbers("attitudes", *form).copy()
    if form == QUATERNION:
        values[known] = quaternion_from_rotation(turned[known])
    elif form == _ROLLED:
        values[known] = roll_pitch_yaw_from_rotation(turned[known], frame_of(block))
    else:
        values[known] = angles_from_rotation((_BACK @ turned[known]).transpose(0, 2, 1))
    block.put("attitudes", form, values)


def level_axes(turned: np.ndarray) -> np.ndarray:
    """Level axes (n, 3, 3) at attitudes: rows heading, right and down, in the world.

    Heading is where the camera's axis and the top of its picture together point horizontally:
    the top of a picture that looks down, the axis of one that looks ahead.
    """
    ahead = turned[:, 2, :2] - turned[:, 1, :2]
    length = np.hypot(*ahead.T)
    east, north = np.where(length > 1e-9, ahead.T / np.maximum(length, 1e-9), [[0.0], [1.0]])
    zero = np.zeros(len(turned))
    rows = [[east, north, zero], [north, -east, zero], [zero, zero, zero - 1.0]]
    return np.array(rows).transpose(2, 0, 1)
