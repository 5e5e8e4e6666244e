"""From a fitted pattern that turns while rows are read to a readout time: star, wheel and bar.

All three are polar patterns: a direction on the target is seen, on the row y, turned on by
`rate (y - reference)`, and readout = rate (L - 1) / angular velocity.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from corridor.core.camera import SLOWEST_READOUT_S
from corridor.core.errors import InputError
from corridor.tools.readout.photograph import CannotMeasure, Photograph
from corridor.tools.readout.result import Readout, sigma_with_speed

# Stacked sensors, the fastest, take some 4 ms for a picture; a part of one takes less.
_FASTEST_MS = 1.0


@dataclass(frozen=True)
class Known:
    """What is known beside the pictures: the speed, its standard error in per cent, and perhaps
    sense and row direction as in the stored picture; warnings: what is to be said of the speed."""

    turns_per_second: float
    speed_sigma_percent: float = 0.0
    sense: str | None = None
    row_direction: str | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Turning:
    """A pattern fitted to two photographs, and how its turn was measured, for a drawing.

    along: 1 where rows follow each other along y, 0 along x. rate, sigma: radians from a row to the
    next, clockwise positive. points (n, 2) px, measured, with their residuals (n,) px; used (n,):
    no outliers; which (n,): 0 or 1 for the photograph; moving (n,): those on the turning target.
    centre (2,): its axis. curves: for either photograph lines (m, 2) px, as fitted.
    """

    target: str
    photos: tuple[Photograph, Photograph]
    along: int
    rate: float
    sigma: float
    points: np.ndarray
    residuals: np.ndarray
    used: np.ndarray
    which: np.ndarray
    moving: np.ndarray
    centre: np.ndarray
    curves: Sequence[Sequence[np.ndarray]]

    @property
    def rows(self) -> int:
        """Rows of the sensor."""
        return self.photos[0].grey.shape[1 - self.along]

    @property
    def row(self) -> np.ndarray:
        """Rows (n,) px of the points from the target's axis."""
        return self.points[:, self.along] - self.centre[self.along]

    @property
    def rate_deg(self) -> float:
        """Degrees from a row to the next, as fitted."""
        return math.degrees(self.rate)

    @property
    def turned_deg(self) -> np.ndarray:
        """Turn (n,) in degrees seen at the points."""
        far = np.maximum(np.hypot(*(self.points - self.centre).T), 1.0)
        return np.degrees(self.rate * self.row + self.residuals / far)

    def check_turns(self, least_deg: float) -> None:
        """Raises CannotMeasure where the turn during the readout is below a limit or five sigmas,
        and says which."""
        turned, sigma = (math.degrees(a) * (self.rows - 1) for a in (abs(self.rate), self.sigma))
        name = self.photos[1].name
        if turned < least_deg:
            raise CannotMeasure(
                f"the {self.target} in {name} does not turn: {turned:.3f} degrees during the "
                f"readout, with a sigma of {sigma:.3f}"
            )
        if turned < 5 * sigma:
            raise CannotMeasure(
                f"how far the {self.target} in {name} turns cannot be measured to a fifth: "
                f"{turned:.2f} degrees during the readout, with a sigma of {sigma:.2f}"
            )

    def readout(
        self, known: Known, method: str, extra: dict[str, Any], warnings: tuple[str, ...] = ()
    ) -> Readout:
        """The result; the speed goes into it one to one. Raises as `directions` and `Readout`."""
        axis = "y" if self.along else "x"
        direction, sense, look_alike = directions(axis, self.rate, known)
        omega = 2 * math.pi * known.turns_per_second
        per_rate = 1e3 * (self.rows - 1) / omega
        readout = abs(self.rate) * per_rate
        if readout > 1e3 * SLOWEST_READOUT_S:
            raise CannotMeasure(
                f"the readout time would be {readout:,.0f} ms, longer than that of any camera: do "
                f"the photographs show one {self.target} at rest and turning, "
                f"{known.turns_per_second:g} times a second?"
            )
        fast = ()
        if readout < _FASTEST_MS:
            fast = (
                f"a readout time of {readout:.2g} ms is shorter than that of any known rolling "
                f"shutter: are {known.turns_per_second:g} turns those of a minute? Then it is "
                f"{60 * readout:.3g} ms",
            )
        found = Readout(
            target=self.target,
            method=method,
            readout_ms=readout,
            sigma_ms=sigma_with_speed(readout, self.sigma * per_rate, known.speed_sigma_percent),
            row_axis=axis,
            row_direction=direction,
            rows=self.rows,
            rotation_sense=sense,
            angular_velocity_deg_s=math.degrees(omega),
            rotation_deg=abs(self.rate_deg) * (self.rows - 1),
            warnings=(*known.warnings, *warnings, *look_alike, *fast),
            extra=extra,
            drawing=self,
        )
        return found.beside_published(self.photos[1])


def bent(
    place: Callable[[np.ndarray], np.ndarray],
    angle: np.ndarray,
    rate: float,
    row: int,
    reference: float,
    rounds: int = 12,
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (..., 2) at which directions on a turning target are seen, and how far it had turned.

    place: directions (...) -> pixels. angle: directions as the target stood on the row `reference`.
    """
    turned = np.zeros(np.shape(angle))
    pixels = place(angle + turned)
    for _ in range(rounds if rate else 0):
        turned = rate * (pixels[..., row] - reference)
        pixels = place(angle + turned)
    return pixels, turned


def directions(
    axis: str, rate: float, known: Known
) -> tuple[str | None, str | None, tuple[str, ...]]:
    """Row direction, sense and warnings from the sign of the rotation per row.

    axis: "y" or "x". rate: radians the target turns from a row to the next in the order of
    growing y (x), clockwise positive.
    Raises InputError where what is known contradicts itself or the pictures.
    """
    sense, row_direction = known.sense, known.row_direction
    forward, backward = ("down", "up") if axis == "y" else ("right", "left")
    if row_direction not in (None, forward, backward):
        raise InputError(
            f"--row-direction {row_direction} contradicts the pictures: their rows follow each "
            f"other along {axis}, use {forward} or {backward}"
        )
    with_rows, against = ("cw", "ccw") if rate > 0 else ("ccw", "cw")
    if row_direction is None and sense is None:
        warning = (
            f"({forward}, {with_rows}) and ({backward}, {against}) look alike: give --sense or "
            "--row-direction to know which"
        )
        return None, None, (warning,)
    if row_direction is None:
        return (forward if sense == with_rows else backward), sense, ()
    found = with_rows if row_direction == forward else against
    if sense not in (None, found):
        raise InputError(
            f"sense {sense} with row direction {row_direction} contradicts the pictures, in which "
            f"rows {row_direction} go with {found}: correct one of the two"
        )
    return row_direction, found, ()
