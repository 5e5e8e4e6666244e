"""The shutter reads its rows one after the other while the camera moves on.

Exact in the row: the centre moves with the velocity and the camera turns with its angular rate
(where images.csv gives one) for the time between the middle row and the row of the point.

Source: Zhou 2019, chapter 7; Zhou et al. 2020, two-step correction.
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, Variant
from corridor.core.errors import InputError

# An estimated readout this far from the stated one, in sigmas and as a share, is told.
_FAR_SIGMAS, _FAR_SHARE = 3.0, 0.15
# A stated shutter that is left out and moves the rows of a picture by more than this (px) is told.
_MOVED_PX = 1.0
# Of 1,223 published readouts the longest takes 299 ms (Fujifilm GFX 50S, all rows of a still).
# Source: horshack-dpreview/RollingShutter, full_sensor.json, 2026.
LONGEST_S = 0.3

_PER_FLIGHT = Variant(
    slug="rolling_shutter_per_flight",
    group="flight",
    title="Rolling shutter of each flight: another mode of the camera, or another camera",
    called="a rolling shutter of its own in each flight",
    revealed_by="strips flown both ways, across each other, at several speeds in each flight",
    unobservable_when=(
        "the drone hovers, or a flight keeps one speed relative to the picture and has a camera of "
        "its own"
    ),
    about="""Each flight has a readout of its own: another picture size or mode, or another camera.

    Source: Zhou 2019, chapter 7 (one readout), with one set of values a flight.
    """,
)


class RollingShutter(LinearEffect):
    slug = "rolling_shutter"
    title = "Rolling shutter: rows read one after the other while the camera moves"
    called = "the camera's rolling shutter"
    place = "motion"
    needs = ("images.vx", "images.vy", "images.vz")
    takes = ("images.wx", "images.wy", "images.wz")
    revealed_by = "strips flown both ways, across each other, at several speeds or tilts"
    unobservable_when = (
        "the drone hovers, or all strips have one speed relative to the picture and the camera is "
        "free: affine distortion or focal length take it"
    )
    variants = (_PER_FLIGHT,)
    unknowns = [
        Parameter("readout", "s", 0.030, text="from the first to the last row", most=LONGEST_S)
    ]

    def stated(self, block):
        """The readout_s of the cameras in block.toml."""
        given = {name: c.readout_s for name, c in block.cameras.items() if c.readout_s is not None}
        if not given:
            return None
        if self.group == "camera":
            return {"readout": given}
        if len(set(given.values())) > 1 or len(given) < len(block.cameras):
            raise InputError(
                "block.toml: its cameras state different values of readout_s, or not all state "
                f"one: write {self.slug}@camera, or give one readout for all"
            )
        return {"readout": next(iter(given.values()))}

    def doubts(self, block, found):
        return readout_doubts(block, found)

    def missed(self, found):
        """By the readout that the block states; affinity takes up a shutter at one speed."""
        block, out = found.block, []
        if {"b1", "b2"} & found.free or not found.height > 0:
            return out
        speed = np.linalg.norm([block.column("images", v) for v in ("vx", "vy", "vz")], axis=0)
        for name, camera in block.cameras.items():
            mine = np.isfinite(speed) & (block.images["camera"] == name).to_numpy()
            if not camera.readout_s or not mine.any():
                continue
            moved = float(np.median(speed[mine])) * camera.readout_s
            pixels = moved * camera["f"] / found.height
            if pixels > _MOVED_PX:
                out.append(
                    f"block.toml states that camera {name} reads a picture in "
                    f"{1000 * camera.readout_s:.1f} ms, while it flies {moved:.2f} m or "
                    f"{pixels:.0f} px, and the model takes the shutter as global: an effect of "
                    f"`corridor effects` on the motion ({self.slug}; with rates.csv one "
                    "that takes them) estimates it, `corridor correct` takes the stated one out."
                )
        return out

    def derivative(self, context):
        """Centre v t and rotation w t, with t = readout (row - middle row) / (rows - 1)."""
        derivative = np.zeros((len(context), 6, 1))
        row = context.row[:, None]
        np.multiply(context.velocity, row, out=derivative[:, :3, 0])
        if context.images.turns:
            # An unknown rate leaves the translation, which matters more.
            np.multiply(np.nan_to_num(context.angular_rate), row, out=derivative[:, 3:, 0])
        return derivative


def readout_doubts(block, found):
    """Sentences on a readout that no shutter has, or that is far from the stated one."""
    out = []
    for row in found[found["parameter"] == "readout"].itertuples(index=False):
        value = f"{1000 * row.value:.1f} +- {1000 * row.sigma:.1f} ms"
        cameras = block.cameras
        mine = [cameras[row.group]] if row.group in cameras else cameras.values()
        stated = {camera.readout_s for camera in mine} - {None}
        known = stated.pop() if len(stated) == 1 else None
        off = abs(row.value - (known or 0.0))
        if row.value < -2 * row.sigma:
            out.append(
                f"A readout of {value} is negative: the rows run the other way (row_direction in "
                "block.toml), or this value is not reliable, because speed and flight direction "
                "vary too little in the pictures."
            )
        elif known and row.sigma > 0 and off > max(_FAR_SIGMAS * row.sigma, _FAR_SHARE * known):
            out.append(
                f"A readout of {value} was estimated where block.toml states {1000 * known:.1f} "
                "ms: the velocities are wrong, the flight does not determine the readout, or the "
                "camera was in another mode."
            )
    return out
