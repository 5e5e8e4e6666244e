"""The camera turns during the readout, and not evenly.

With rates.csv: the camera turns as its gyroscope says, and moves with the velocity of images.csv
(where it is known), for one readout time; the gyroscope's clock may be late by a delay. Without:
nobody has measured how the camera turns, and each image has one small rotation from its first row
to its last about each axis of the camera.

Source: Zhou 2019, section 4.3.3 (rolling shutter, rotation apart from translation); the delay:
data/sequoia, whose gyroscope comes 43 ms late.
"""

import numpy as np

from corridor.core.effects.catalogue.rolling_shutter import LONGEST_S, readout_doubts
from corridor.core.effects.contract import Effect, Parameter, linear

# Rates of a rocking wing or a gimbal change a few times within one readout.
_CURVE_DEGREE = 8
_USUAL_READOUT_S = 0.030


class RollingShutterRotation(Effect):
    slug = "rolling_shutter_rotation"
    called = "the camera's rotation while the rows are read"
    title = "Rolling shutter: turning during the readout, by the gyroscope or an image at a time"
    place = "motion"
    group = "image"
    measured = False
    # Turns about the other axes shift rows as a whole, as many things do; this one shears them.
    proper = ("z",)
    revealed_by = "many tie points in every image, over all of its rows"
    unobservable_when = "an image has few points, or points in few rows"

    def form(self, block):
        """With rates.csv: one readout and one delay, in place of a rotation an image."""
        if self.measured or not len(block.rates):
            return self
        # Asked for as `slug@flight`, the curve has one readout and delay a flight.
        curve = self.per("block" if self.group == "image" else self.group)
        curve.measured, curve.row_degree = True, _CURVE_DEGREE
        curve.needs = ("images.time_s", "rates.wx", "rates.wy", "rates.wz")
        curve.takes = ("images.vx", "images.vy", "images.vz")
        curve.revealed_by = "a gyroscope, and rates that change from image to image"
        return curve

    def parameters(self, block):
        if self.measured:
            given = [c.readout_s for c in block.cameras.values() if c.readout_s]
            start = given[0] if given else _USUAL_READOUT_S
            return [
                # Without a readout the delay would do nothing: both start from a shutter.
                Parameter("readout", "s", scale=0.030, start=start, most=LONGEST_S),
                Parameter("delay", "s", scale=0.020, text="of the gyroscope's clock"),
            ]
        # 0.3 degrees a second for 25 ms.
        scale = np.radians(0.3) * 0.025
        return [Parameter(axis, "rad", scale=scale) for axis in ("x", "y", "z")]

    def stated(self, block):
        """The readout_s of block.toml, and a gyroscope on time."""
        given = {c.readout_s for c in block.cameras.values()}
        if not self.measured or len(given) != 1 or None in given:
            return None
        return {"readout": given.pop(), "delay": 0.0}

    def doubts(self, block, found):
        return readout_doubts(block, found)

    def shift(self, context, values):
        """Turn from the middle row to this one.

        With rates: that of the gyroscope from delay to delay + readout s, with the row s from
        -1/2 to 1/2, and the centre by v readout s. Else rotation by values s.
        """
        if self.measured:
            return self._by_curve(context, values)
        derivative = context.row[:, None, None] * np.eye(6, 3, -3)
        return linear(derivative, values), derivative

    def _by_curve(self, context, values):
        readout, delay = np.broadcast_to(values, (len(context), 2)).T
        shift, derivative = np.zeros((len(context), 6)), np.zeros((len(context), 6, 2))
        row = context.row
        # An unknown velocity leaves the rotation, which matters more.
        derivative[:, :3, 0] = np.nan_to_num(context.velocity) * row[:, None]
        shift[:, :3] = derivative[:, :3, 0] * readout[:, None]
        turn, by_end, by_begin = context.turn(delay, delay + readout * row)
        # Where nothing turns (no readout), nothing is rounded either.
        shift[:, 3:] = np.where((readout * row != 0.0)[:, None], turn, 0.0)
        derivative[:, 3:, 0] = by_end * row[:, None]
        derivative[:, 3:, 1] = by_end + by_begin
        return shift, derivative
