"""The axis of a corridor: straight lines joined by arcs."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from corridor.core.errors import InputError

_FARTHEST = 4.1e7  # m: once around the Earth


@dataclass(frozen=True)
class Axis:
    """A polyline whose corners are rounded, with positions counted along it (stations).

    vertices: (n, 2) metres. bend_radius: of the arcs, metres; smaller where two corners are too
    near each other for it.
    """

    vertices: Sequence[Sequence[float]]
    bend_radius: float = 150.0
    length: float = field(init=False)
    _pieces: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        points = np.asarray(self.vertices, dtype=float)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise InputError("the axis of a corridor is a list of two or more positions [x, y]")
        legs = np.diff(points, axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        if not np.all(np.isfinite(points)) or not np.all(lengths > 0):
            raise InputError("the axis of a corridor has a position twice: leave one out")
        if np.abs(points).max() > _FARTHEST:
            raise InputError(
                f"axis_m holds {np.abs(points).max():g}, which is not a place on Earth: give "
                "metres of a map grid"
            )
        heading = np.arctan2(legs[:, 1], legs[:, 0])
        turn = (np.diff(heading) + np.pi) % (2 * np.pi) - np.pi
        if np.any(np.abs(turn) > np.radians(150)):
            raise InputError("the axis of a corridor turns back on itself: fly two plans")
        # An arc takes r tan(turn / 2) of both legs, at most half of an inner one.
        room = np.where(np.arange(len(legs)) % max(len(legs) - 1, 1) == 0, 1.0, 0.5) * lengths
        half = np.abs(np.tan(turn / 2))
        radius = np.minimum(
            self.bend_radius, np.minimum(room[:-1], room[1:]) / np.maximum(half, 1e-12)
        )
        cut = np.concatenate([[0.0], radius * half, [0.0]])
        rows, station = [], 0.0
        for k, (start, length) in enumerate(zip(points[:-1], lengths, strict=True)):
            direction = legs[k] / length
            straight = length - cut[k] - cut[k + 1]
            rows.append((station, *(start + cut[k] * direction), heading[k], 0.0))
            station += straight
            if k < len(turn) and abs(turn[k]) > 1e-12:
                corner = points[k + 1] - cut[k + 1] * direction
                rows.append((station, *corner, heading[k], np.sign(turn[k]) / radius[k]))
                station += radius[k] * abs(turn[k])
        object.__setattr__(self, "_pieces", np.array(rows))
        object.__setattr__(self, "length", float(station))

    def at(self, station: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and unit tangents (n, 2) at stations (n,); both ends go on straight."""
        station = np.asarray(station, dtype=float)
        starts = self._pieces[:, 0]
        row = np.clip(np.searchsorted(starts, station, side="right") - 1, 0, len(starts) - 1)
        begin, x, y, heading, bend = self._pieces[row].T
        s = station - begin
        angle = bend * s
        # The chord of an arc: length s sinc(angle / 2), direction in the middle of the turn.
        chord = s * np.sinc(angle / (2 * np.pi))
        middle = heading + angle / 2
        position = np.stack([x + chord * np.cos(middle), y + chord * np.sin(middle)], axis=-1)
        tangent = np.stack([np.cos(heading + angle), np.sin(heading + angle)], axis=-1)
        return position, tangent

    def place(self, station: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Positions (n, 2) at stations and distances to the right of the axis (n,), metres."""
        position, tangent = self.at(station)
        right = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
        return position + np.asarray(across, dtype=float)[..., None] * right

    def nearest(self, places: np.ndarray) -> np.ndarray:
        """Stations (n,) of the points of the axis that are nearest to places (n, 2).

        Found on a raster of a metre, or a thousandth of the axis, then along the tangent there;
        beyond its ends the axis goes on straight.
        """
        raster = np.linspace(0.0, self.length, max(int(min(self.length, 1e6)), 1000) + 1)
        line, tangent = self.at(raster)
        places = np.asarray(places, dtype=float)
        row = np.array([np.argmin(((line - place) ** 2).sum(axis=1)) for place in places])
        return raster[row] + np.einsum("nk,nk->n", places - line[row], tangent[row])
