"""Statistics of antenna positions: by time, place, flight, velocity and frequency."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from corridor.diagnosis.replicates.statistics.statistic import (
    Curve,
    Form,
    Statistic,
    corridor_frame,
    named,
)

# Antenna positions that a bin must have, and those of a flight that has a spectrum.
FEWEST_EPOCHS, FEWEST_OF_SPECTRUM = 3, 16
# Ends of the bands of a spectrum, cycles per image.
BANDS = np.array([0.0, 0.03, 0.06, 0.12, 0.25, 0.51])


def gnss_forms(replicator, missing: dict[str, str]) -> Iterator[Form]:
    """Residuals of the antenna; missing: takes what could not be formed, and the column to add."""
    images, image = replicator.system.images, replicator.system.gnss.image
    one = np.ones(len(image))
    timed = bool(np.isfinite(images.time[image]).all())
    if not timed:
        missing["GNSS residuals by time"] = "images.time_s"
    origin, axes = corridor_frame(images.centre)
    along = (images.centre[image][:, :2] - origin) @ axes[0]
    by_flight = Curve.codes(
        images.flight[image].astype(float), one, tuple(images.flight_names), FEWEST_EPOCHS
    )
    place = "along the corridor (m)"
    rows = (
        ("by time", "time (s)" if timed else "epoch", _by_time(replicator.series, one)),
        ("along the corridor", place, Curve.even(along, 10, one, FEWEST_EPOCHS)),
        ("by flight", "flight", by_flight),
    )
    for k, axis in enumerate("xyz"):
        for by, what, bins in rows:
            yield _mean(f"{axis} {by}", what, bins, lambda r, k=k: r.gnss[:, k])
        side = ("right", "down", "forward")[k]
        name = f"{side} of the camera by flight"
        yield _mean(name, "flight", by_flight, lambda r, k=k: r.gnss_in_camera[:, k])
        yield from _spectrum(replicator.series, images, k, axis)
    yield _growth(images.centre[image] - images.centre.mean(axis=0))
    height = images.centre[image][:, 2]
    if np.ptp(height) > 0.05 * max(abs(float(np.mean(height - images.ground))), 1.0):
        bins = Curve.equal(height, 6, one, FEWEST_EPOCHS)
        yield _mean("z by height", "height (m)", bins, lambda r: r.gnss[:, 2])
    yield from _by_velocity(images, image, missing)


def _mean(name: str, axis: str, curve: Curve, of) -> Form:
    return Form(curve.statistic(f"GNSS {name}", "gnss", "m", axis), lambda r: curve.mean(of(r)))


def _by_time(series, one: np.ndarray) -> Curve:
    """Up to eight parts of each flight, of four positions or more."""
    time, part, first = np.full(len(one), np.nan), np.full(len(one), -1), 0
    for s in series:
        time[s.rows] = s.time
        count = max(1, min(8, len(s.rows) // 4))
        part[s.rows] = first + np.arange(len(s.rows)) * count // len(s.rows)
        first += count
    return Curve.of(part, time, one, FEWEST_EPOCHS)


def _growth(away: np.ndarray) -> Form:
    spread = away.std(axis=0)
    wide = np.flatnonzero(spread > 1e-3)
    statistic = Statistic(
        "GNSS growing with the place",
        "gnss",
        "m",
        "axis; for one spread (RMS) of the positions",
        wide.astype(float),
        tuple("xyz"[k] for k in wide),
    )

    def slopes(r) -> np.ndarray:
        each = [r.gnss[:, k] @ away[:, k] / (away[:, k] @ away[:, k]) for k in wide]
        return np.array(each) * spread[wide]

    return Form(statistic, slopes)


def _by_velocity(images, image: np.ndarray, missing: dict[str, str]) -> Iterator[Form]:
    velocity = images.velocity
    moving = np.isfinite(velocity).all(axis=1) & (np.hypot(*velocity[:, :2].T) > 0.2)
    if not moving[image].any():
        missing["GNSS residuals by velocity"] = "images.vx, images.vy, images.vz"
        return
    v = np.where(moving[image][:, None], np.nan_to_num(velocity[image]), 0.0)
    direction = v[:, :2] / np.maximum(np.hypot(*v[:, :2].T), 1e-9)[:, None]
    left = np.column_stack([-direction[:, 1], direction[:, 0]])
    what = "direction of the velocity"
    sectors = Curve.sectors(velocity, moving, image, np.ones(len(image)), FEWEST_EPOCHS)
    for name, way in (("along", direction), ("across", left)):
        yield _mean(
            f"{name} the velocity by its direction",
            what,
            sectors,
            lambda r, way=way: np.einsum("ni,ni->n", r.gnss[:, :2], way),
        )
    yield _mean(f"z by {what}", what, sectors, lambda r: r.gnss[:, 2])
    square = float((v**2).sum())
    yield Form(
        named("GNSS delay: along the velocity, per speed", "gnss", "s", "", ("all together",)),
        lambda r: np.array([(r.gnss * v).sum() / square]),
    )


def _spectrum(series, images, k: int, axis: str) -> Iterator[Form]:
    """Power by frequency, all flights together, and second differences by flight."""
    series = [s for s in series if len(s.rows) >= FEWEST_OF_SPECTRUM]
    if not series:
        return
    frequency = [np.fft.rfftfreq(len(s.rows))[1:] for s in series]
    bands = len(BANDS) - 1
    band = np.clip(np.searchsorted(BANDS, np.concatenate(frequency)) - 1, 0, bands - 1)
    count = np.bincount(band, minlength=bands)
    full = count > 0
    middle = np.bincount(band, np.concatenate(frequency), bands)[full] / count[full]

    def power(r) -> np.ndarray:
        found = []
        for s in series:
            v = r.gnss[s.rows, k]
            found.append(np.abs(np.fft.rfft(v - v.mean())[1:]) ** 2 / len(v))
        sums = np.bincount(band, np.concatenate(found), bands)[full]
        return np.log10(np.maximum(sums / count[full], 1e-30))

    what = "frequency (cycles per image)"
    yield Form(Statistic(f"GNSS {axis} spectrum", "gnss", "log10 m²", what, middle), power)
    names = [images.flight_names[s.flight] for s in series]
    yield Form(
        named(f"second differences of the poses against GNSS {axis}", "gnss", "m", "flight", names),
        lambda r: np.array([np.sqrt(np.mean(np.diff(r.gnss[s.rows, k], 2) ** 2)) for s in series]),
    )
