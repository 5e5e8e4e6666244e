"""How far a camera has turned between two moments, from the rates that a gyroscope recorded."""

import numpy as np
from scipy.spatial.transform import Rotation

from corridor.core.block import Block
from corridor.core.errors import InputError

RATES = ("wx", "wy", "wz")


class Gyroscope:
    """Angular rates of rates.csv, integrated to attitudes.

    Rates between two epochs are interpolated smoothly (cubic); before the first and after the last
    epoch of a record they stay what they were there: the angle goes on. A record belongs to an
    image, to a flight or to the block, as the columns of rates.csv say.
    """

    def __init__(self, block: Block):
        table = block.rates
        time = block.column("rates", "time_s")
        rate = np.stack([block.column("rates", axis) for axis in RATES], axis=1)
        owner, self.record_of_image = _records(block)
        order = np.lexsort((time, owner))
        self.time, self.rate, owner = time[order], rate[order], owner[order]
        count = int(owner.max(initial=-1)) + 1
        self.first = np.searchsorted(owner, np.arange(count))
        self.last = np.searchsorted(owner, np.arange(count), side="right") - 1
        short = np.flatnonzero(self.last <= self.first)
        if len(short):
            row = int(order[self.first[short[0]]])
            raise InputError(
                f"{block.where('rates', row)}: one epoch alone shows no rotation: give the rates "
                "before and after each exposure, at least two epochs"
            )
        # Records one after the other on one axis, so that one search finds the epoch of any row.
        self._begin = self.time[self.first]
        length = self.time[self.last] - self._begin
        self._shift = np.concatenate([[0.0], np.cumsum(length + 1.0)[:-1]])
        self._axis = self.time - self._begin[owner] + self._shift[owner]
        self._upto = length
        step = np.diff(self.time)
        if (step[np.diff(owner) == 0] <= 0).any():
            row = int(order[np.flatnonzero((step <= 0) & (np.diff(owner) == 0))[0] + 1])
            raise InputError(
                f"{block.where('rates', row)}: time_s is there twice in one record: remove a row"
            )
        self.slope = np.concatenate(
            [
                np.gradient(self.rate[a : b + 1], self.time[a : b + 1], axis=0)
                for a, b in zip(self.first, self.last, strict=True)
            ]
        )
        at = np.arange(max(len(table) - 1, 0))
        turns = Rotation.from_rotvec(self._within(at, np.ones(len(at)))[0])
        self.attitude = _followed(turns, np.arange(len(table)) - self.first[owner])

    def turn(
        self, image: np.ndarray, begin: np.ndarray, end: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rotation vector (n, 3), rad, from the camera at begin to the camera at end.

        image: (n,) rows of images.csv; begin, end: (n,) seconds on the clock of rates.csv.
        Also its derivatives (n, 3), rad/s, by end and by begin. NaN without a record of the image.
        Source: the turn m has dm/dt = J(m)^-1 w with the right Jacobian J of the rotation group
        (J. Sola et al. 2018, "A micro Lie theory", eq. 144).
        """
        record = self.record_of_image[image]
        known = record >= 0
        record = np.where(known, record, 0)
        q0, w0 = self._at(record, begin)
        q1, w1 = self._at(record, end)
        m = (q0.inv() * q1).as_rotvec()
        by_end = _inverse_jacobian(m, w1, 1.0)
        by_begin = -_inverse_jacobian(m, w0, -1.0)
        for out in (m, by_end, by_begin):
            out[~known] = np.nan
        return m, by_end, by_begin

    def _at(self, record, time):
        """Attitude (n,) since the record's first epoch, and angular rate (n, 3), at times."""
        since = time - self._begin[record]
        axis = np.clip(since, 0.0, self._upto[record]) + self._shift[record]
        at = np.searchsorted(self._axis, axis, side="right") - 1
        at = np.clip(at, self.first[record], self.last[record] - 1)
        since = time - self.time[at]
        step = self.time[at + 1] - self.time[at]
        share = np.clip(since / step, 0.0, 1.0)
        angle, rate = self._within(at, share)
        angle += rate * (since - share * step)[:, None]
        return self.attitude[at] * Rotation.from_rotvec(angle), _right_jacobian(angle, rate)

    def _within(self, at, share):
        """Integral of the rate (n, 3) from epoch at to a share of the step, and the rate there."""
        h, s = (self.time[at + 1] - self.time[at])[:, None], share[:, None]
        w0, w1 = self.rate[at], self.rate[at + 1]
        d0, d1 = h * self.slope[at], h * self.slope[at + 1]
        angle = h * (
            w0 * (s - s**3 + s**4 / 2)
            + w1 * (s**3 - s**4 / 2)
            + d0 * (s**2 / 2 - 2 * s**3 / 3 + s**4 / 4)
            + d1 * (s**4 / 4 - s**3 / 3)
        )
        rate = (
            w0 * (1 - 3 * s**2 + 2 * s**3)
            + w1 * (3 * s**2 - 2 * s**3)
            + d0 * (s - 2 * s**2 + s**3)
            + d1 * (s**3 - s**2)
        )
        return angle, rate


def _followed(turns: Rotation, since: np.ndarray) -> Rotation:
    """Attitudes (n,), each the one before and its turn; records begin where `since` is zero.

    turns (n - 1,): from each epoch to the next. since (n,): epochs since the first of the record.
    Products of pairs, of fours, of eights ...: one after the other they would take minutes of an
    hour at 200 Hz. Source: Hillis and Steele 1986, "Data parallel algorithms".
    """
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (len(since), 1))
    goes_on = np.flatnonzero(since > 0)
    quaternion[goes_on] = turns.as_quat()[goes_on - 1]
    reach = 1
    while (at := np.flatnonzero(since >= reach + 1)).size:
        before = Rotation.from_quat(quaternion[at - reach])
        quaternion[at] = (before * Rotation.from_quat(quaternion[at])).as_quat()
        reach *= 2
    return Rotation.from_quat(quaternion)


def _records(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Record (epochs,) of each row of rates.csv, and record (images,) of each image, -1: none."""
    for column, names in (
        ("image", block.images["image"].to_numpy(object)),
        ("flight", np.array(block.flight_names, dtype=object)[block.image_flight]),
    ):
        if column in block.rates and block.rates[column].notna().any():
            given = block.rates[column].to_numpy(object)
            found, owner = np.unique(given.astype(str), return_inverse=True)
            at = {name: n for n, name in enumerate(found)}
            return owner, np.array([at.get(str(name), -1) for name in names])
    return np.zeros(len(block.rates), np.int64), np.zeros(len(block.images), np.int64)


def _right_jacobian(m, v):
    """J(m) v, to the third order: a step of a gyroscope turns by milliradians."""
    once = np.cross(m, v)
    return v - once / 2 + np.cross(m, once) / 6


def _inverse_jacobian(m, v, side):
    """J(m)^-1 v; side 1: right, -1: left Jacobian. To the fifth order in the turn."""
    once = np.cross(m, v)
    square = np.sum(m * m, axis=1, keepdims=True)
    return v + side * once / 2 + np.cross(m, once) * (1 / 12 + square / 720)
