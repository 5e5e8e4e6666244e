"""Statistics of antenna positions: by time, place, flight and frequency."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from corridor.diagnosis.bootstrap.statistics.statistic import (
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
