"""Statistics of antenna positions: by time, place, flight, velocity and frequency."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from corridor.diagnosis.statistics.bins import Curve, corridor_frame
from corridor.diagnosis.statistics.statistic import Statistic
from corridor.geometry import CLIPPED, robust_scale

if TYPE_CHECKING:
    from corridor.diagnosis.statistics.ruler import Ruler, Seen

# Antenna positions that a bin must have.
FEWEST_EPOCHS = 3


def add_gnss(ruler: Ruler) -> None:
    """Residuals of the antenna by time, place, flight and velocity, and their spectra."""
    images, series = ruler.images, ruler.believed.series
    image = ruler.believed.system.gnss.image
    one = np.ones(len(image))
    ruler.gnss_limit = CLIPPED * robust_scale(ruler.believed.fit.gnss, axis=0, least=1e-9)
    flights = tuple(images.flight_names)
    flight = images.flight[image]
    time = np.full(len(image), np.nan)
    part = np.full(len(image), -1)
    first = 0
    for s in series:
        time[s.rows] = s.time
        count = max(1, min(8, len(s.rows) // 4))
        part[s.rows] = first + np.arange(len(s.rows)) * count // len(s.rows)
        first += count
    timed = bool(np.isfinite(images.time[image]).all())
    if not timed:
        ruler.missing["GNSS residuals by time"] = "images.time_s"
    by_time = Curve.of(part, time, one, FEWEST_EPOCHS)
    origin, axes = corridor_frame(images.centre)
    along = (images.centre[image][:, :2] - origin) @ axes[0]
    by_place = Curve.even(along, 10, one, FEWEST_EPOCHS)
    by_flight = Curve.codes(flight.astype(float), one, flights, FEWEST_EPOCHS)
    for k, axis in enumerate("xyz"):
        what = "time (s)" if timed else "epoch"
        _antenna(ruler, f"GNSS {axis} by time", what, by_time, lambda seen, k=k: seen.gnss[:, k])
        _antenna(ruler,
            f"GNSS {axis} along the corridor", "along the corridor (m)", by_place,
            lambda seen, k=k: seen.gnss[:, k],
        )  # fmt: skip
        _antenna(
            ruler, f"GNSS {axis} by flight", "flight", by_flight, lambda seen, k=k: seen.gnss[:, k]
        )
        _antenna(ruler,
            f"GNSS {'right down forward'.split()[k]} of the camera by flight", "flight",
            by_flight, lambda seen, k=k: seen.gnss_in_camera[:, k],
        )  # fmt: skip
        _spectrum(ruler, k, axis)
    away = images.centre[image] - images.centre.mean(axis=0)
    spread = away.std(axis=0)
    wide = np.flatnonzero(spread > 1e-3)
    ruler.add(
        Statistic(
            "GNSS growing with the place", "gnss", "m", "axis, per standard deviation of it",
            wide.astype(float), tuple("xyz"[k] for k in wide),
        ),
        lambda seen: np.array(
            [seen.gnss[:, k] @ away[:, k] / (away[:, k] @ away[:, k]) for k in wide]
        )
        * spread[wide],
    )  # fmt: skip
    height = images.centre[image][:, 2]
    if np.ptp(height) > 0.05 * max(abs(float(np.mean(height - images.ground))), 1.0):
        by_height = Curve.equal(height, 6, one, FEWEST_EPOCHS)
        _antenna(ruler, "GNSS z by height", "height (m)", by_height, lambda seen: seen.gnss[:, 2])
    velocity = images.velocity
    moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
    if not moving[image].any():
        ruler.missing["GNSS residuals by velocity"] = "images.vx, images.vy, images.vz"
        return
    v = np.where(moving[image][:, None], np.nan_to_num(velocity[image]), 0.0)
    direction = v[:, :2] / np.maximum(np.hypot(*v[:, :2].T), 1e-9)[:, None]
    left = np.column_stack([-direction[:, 1], direction[:, 0]])
    sectors = Curve.sectors(velocity, moving, image, one, FEWEST_EPOCHS)
    for name, frame in (("along", direction), ("across", left)):
        _antenna(ruler,
            f"GNSS {name} the velocity by its direction", "direction of the velocity", sectors,
            lambda seen, frame=frame: np.einsum("ni,ni->n", seen.gnss[:, :2], frame),
        )  # fmt: skip
    _antenna(ruler,
        "GNSS z by direction of the velocity", "direction of the velocity", sectors,
        lambda seen: seen.gnss[:, 2],
    )  # fmt: skip
    square = float((v**2).sum())
    ruler.add(
        Statistic(
            "GNSS delay: along the velocity, per speed", "gnss", "s", "",
            np.zeros(1), ("all together",),
        ),
        lambda seen: np.array([(seen.gnss * v).sum() / square]),
    )  # fmt: skip


def _antenna(ruler: Ruler, name: str, axis: str, curve: Curve, of: Callable) -> None:
    ruler.add(curve.statistic(name, "gnss", "m", axis), lambda seen: curve.mean(of(seen)))


def _spectrum(ruler: Ruler, k: int, axis: str) -> None:
    """Power by frequency, all flights together, and second differences by flight."""
    series = [s for s in ruler.believed.series if len(s.rows) >= 16]
    if not series:
        return
    edges = np.array([0.0, 0.03, 0.06, 0.12, 0.25, 0.51])
    frequency = [np.fft.rfftfreq(len(s.rows))[1:] for s in series]
    band = np.clip(np.searchsorted(edges, np.concatenate(frequency)) - 1, 0, len(edges) - 2)
    count = np.bincount(band, minlength=len(edges) - 1)
    full = count > 0
    middle = np.bincount(band, np.concatenate(frequency), len(edges) - 1)[full] / count[full]

    def power(seen: Seen) -> np.ndarray:
        found = []
        for s in series:
            v = seen.gnss[s.rows, k]
            found.append(np.abs(np.fft.rfft(v - v.mean())[1:]) ** 2 / len(v))
        sums = np.bincount(band, np.concatenate(found), len(edges) - 1)[full]
        return np.log10(np.maximum(sums / count[full], 1e-30))

    ruler.add(
        Statistic(
            f"GNSS {axis} spectrum", "gnss", "log10 m²", "frequency (cycles per image)", middle
        ),
        power,
    )
    names = tuple(ruler.images.flight_names[s.flight] for s in series)
    ruler.add(
        Statistic(
            f"second differences of the poses against GNSS {axis}", "gnss", "m", "flight",
            np.arange(len(series), dtype=float), names,
        ),
        lambda seen: np.array(
            [np.sqrt(np.mean(np.diff(seen.gnss[s.rows, k], 2) ** 2)) for s in series]
        ),
    )  # fmt: skip
