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
    noise, one = replicator.noise.gnss, np.ones(len(image))
    # Of each flight its positions in the order of time.
    flights = [noise.in_time(rows) // 3 for rows, _, axis in noise.blocks() if axis == 0]
    timed = bool(np.isfinite(images.time[image]).all())
    if not timed:
        missing["GNSS residuals by time"] = "images.time_s"
    origin, axes = corridor_frame(images.centre)
    along = (images.centre[image][:, :2] - origin) @ axes[0]
    flight_names = np.array(images.flight_names, dtype=object)[images.flight[image]]
    by_flight = Curve.codes(
        images.flight[image].astype(float), one, tuple(images.flight_names), FEWEST_EPOCHS
    )
    place = "along the corridor (m)"
    rows = (
        ("by time", "time (s)" if timed else "epoch", _by_time(flights, noise.time)),
        ("along the corridor", place, Curve.even(along, 10, one, FEWEST_EPOCHS)),
        ("by flight", "flight", by_flight),
    )
    for k, axis in enumerate("xyz"):
        for by, what, bins in rows:
            yield _mean(f"{axis} {by}", what, bins, lambda r, k=k: r.gnss[:, k])
        side = ("right", "down", "forward")[k]
        name = f"{side} of the camera by flight"
        yield _mean(name, "flight", by_flight, lambda r, k=k: r.gnss_in_camera[:, k])
        yield from _spectrum(flights, flight_names, k, axis)


def _mean(name: str, axis: str, curve: Curve, of) -> Form:
    return Form(curve.statistic(f"GNSS {name}", "gnss", "m", axis), lambda r: curve.mean(of(r)))


def _by_time(flights: list[np.ndarray], time: np.ndarray) -> Curve:
    """Up to eight parts of each flight, of four positions or more."""
    part, first = np.full(len(time), -1), 0
    for rows in flights:
        count = max(1, min(8, len(rows) // 4))
        part[rows] = first + np.arange(len(rows)) * count // len(rows)
        first += count
    return Curve.of(part, time, np.ones(len(time)), FEWEST_EPOCHS)


def _spectrum(flights: list[np.ndarray], flight_names, k: int, axis: str) -> Iterator[Form]:
    """Power by frequency, all flights together, and second differences by flight."""
    flights = [rows for rows in flights if len(rows) >= FEWEST_OF_SPECTRUM]
    if not flights:
        return
    frequency = [np.fft.rfftfreq(len(rows))[1:] for rows in flights]
    bands = len(BANDS) - 1
    band = np.clip(np.searchsorted(BANDS, np.concatenate(frequency)) - 1, 0, bands - 1)
    count = np.bincount(band, minlength=bands)
    full = count > 0
    middle = np.bincount(band, np.concatenate(frequency), bands)[full] / count[full]

    def power(r) -> np.ndarray:
        found = []
        for rows in flights:
            v = r.gnss[rows, k]
            found.append(np.abs(np.fft.rfft(v - v.mean())[1:]) ** 2 / len(v))
        sums = np.bincount(band, np.concatenate(found), bands)[full]
        return np.log10(np.maximum(sums / count[full], 1e-30))

    what = "frequency (cycles per image)"
    yield Form(Statistic(f"GNSS {axis} spectrum", "gnss", "log10 m²", what, middle), power)
    names = [flight_names[rows[0]] for rows in flights]
    yield Form(
        named(f"second differences of the poses against GNSS {axis}", "gnss", "m", "flight", names),
        lambda r: np.array([np.sqrt(np.mean(np.diff(r.gnss[n, k], 2) ** 2)) for n in flights]),
    )
