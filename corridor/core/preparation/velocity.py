"""How fast each camera flew, from what a block knows: neighbours, strips, GNSS or metadata."""

from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import polynomial

from corridor.core.block import VELOCITY, Block
from corridor.core.errors import InputError
from corridor.core.preparation.record import derived, forget
from corridor.core.preparation.smoothing import FASTEST_M_S, of_gnss, of_track, rounding
from corridor.core.preparation.strips import track_runs

METHODS = ("auto", "metadata", "gnss", "strip", "neighbours")


@dataclass
class Velocities:
    """Velocity of every image and how it was found.

    velocity: (images, 3) m/s, world, in the order of images.csv; sigma: (images,) m/s, of one
    axis along the flight, NaN where nothing tells. method: one of METHODS. stamp_s: step to which
    the time stamps are rounded, 0 where they are not; stamp_sigma_s: their standard error.
    notes: what was wrong with the time stamps, sentences.
    """

    velocity: np.ndarray
    sigma: np.ndarray
    method: str
    stamp_s: float = 0.0
    stamp_sigma_s: float = 0.0
    notes: list[str] = field(default_factory=list)

    @property
    def speed(self) -> np.ndarray:
        """(images,) m/s."""
        return np.linalg.norm(self.velocity, axis=1)

    def __str__(self) -> str:
        low, middle, high = np.percentile(self.speed, [0, 50, 100])
        lines = [
            f"velocities: {_TOLD[self.method]}; {low:.2f} to {high:.2f} m/s, median {middle:.2f}"
        ]
        known = self.sigma[np.isfinite(self.sigma)]
        if len(known):
            lines[0] += f", sigma {np.median(known):.2f} m/s"
        return "\n".join([*lines, *self.notes])

    def on(self, block: Block) -> Block:
        """The block with these velocities in images.csv."""
        block = block.copy()
        block.put("images", VELOCITY, self.velocity)
        forget(block, *(f"images.{axis}" for axis in VELOCITY))
        return block


_TOLD = {
    "metadata": "vx, vy, vz of images.csv",
    "gnss": "from antenna positions, not from poses",
    "strip": "one smooth flight a strip, fitted to its camera positions",
    "neighbours": "from the images before and after",
}


def velocities(block: Block, method: str = "auto") -> Velocities:
    """Velocity of every image of a block.

    method: `metadata`: vx, vy, vz of images.csv. `gnss`: from track.csv, or from gnss.csv, as
    `prepare` has them. `neighbours`: displacement over time between the images before and
    after (Zhou 2019, section 7.5, step 2), one-sided at the ends of a strip. `strip`: a
    quadratic in time through all camera positions of a strip, which errors of single time
    stamps hardly move.
    `auto`: the first of these that the block has; from poses, `strip` where time stamps are
    rounded, `neighbours` where not.

    Never across the end of a strip or from one flight or camera to another; without a column
    `strip`, flights are cut where they turn or pause. Equal and unordered time stamps are coped
    with and told. Raises InputError where there are no times, no neighbours, or a velocity
    that nothing can fly (`FASTEST_M_S`).
    """
    if method not in METHODS:
        raise InputError(f"velocities by {method!r} are unknown: use {', '.join(METHODS)}")
    given = block.numbers("images", *VELOCITY)
    if method == "auto":
        method = _best(block, given)
    if method == "metadata":
        remedy = "fill them in, or take velocities from neighbours, strip or gnss"
        block.demand("images", np.isfinite(given), "lacks vx, vy or vz", remedy)
        found = Velocities(given, np.full(len(given), np.nan), "metadata")
    elif method == "gnss":
        found = _from_antennas(block)
    else:
        found = _from_positions(block, method)
    return _checked(block, found)


def _best(block: Block, given: np.ndarray) -> str:
    # What `prepare` derived came from these same positions.
    if np.isfinite(given).all() and "images.vx" not in {one.column for one in derived(block)}:
        return "metadata"
    known = block.images["image"].isin(block.gnss["image"]) if len(block.gnss) else [False]
    if len(block.track) or np.all(known):
        return "gnss"
    return "strip" if rounding(block.column("images", "time_s")) else "neighbours"


def _from_antennas(block: Block) -> Velocities:
    """By the smoother, from track.csv or gnss.csv, with its sigmas along the flight."""
    time = times(block)
    table = of_track(block) if len(block.track) else of_gnss(block)
    if len(block.track):
        fault = "was taken outside track.csv or in a gap of it"
        remedy = "correct time_s, or take velocities from neighbours or strip"
    else:
        fault = "has no position in gnss.csv, or none near it"
        remedy = "take velocities from neighbours or strip"
    block.demand("images", np.isfinite(table), fault, remedy)
    velocity, sigma = table[:, :3], table[:, 3:6]
    speed = np.maximum(np.linalg.norm(velocity, axis=1, keepdims=True), 1e-9)
    along = np.sqrt(np.sum((sigma * velocity / speed) ** 2, axis=1))
    step = rounding(time)
    return Velocities(velocity, along, "gnss", step, step / np.sqrt(12))


def _from_positions(block: Block, method: str) -> Velocities:
    position, time = block.numbers("images", *"xyz"), times(block)
    remedy = "run `corridor adjust` first and take the adjusted block"
    block.demand(
        "images", np.isfinite(position), "has no position, from which velocities follow", remedy
    )
    step = rounding(time)
    notes: list[str] = []
    runs = list(track_runs(block, time, position, notes))
    velocity = np.full((len(time), 3), np.nan)
    off = []
    for rows in runs:
        smooth, late = _smooth(time[rows], position[rows])
        off.append(late)
        velocity[rows] = smooth
    late = np.concatenate(off) if off else np.zeros(0)
    sigma_t = float(np.sqrt(np.nanmean(late**2))) if np.isfinite(late).any() else 0.0
    if step:
        notes.append(
            f"The time stamps are multiples of {step:g} s; camera positions say that they are "
            f"wrong by {sigma_t:.2f} s (one sigma)."
        )
    span = np.full(len(time), np.nan)
    wide = 0
    for rows in runs:
        if method == "neighbours":
            velocity[rows], span[rows], wider = _central(time[rows], position[rows])
            wide += wider
        elif len(rows) > 1:
            t = time[rows] - time[rows].mean()
            span[rows] = np.sqrt(max(np.sum(t * t), 1e-12)) * np.sqrt(2)
    if wide:
        notes.append(
            f"{wide} images have a neighbour with the same time stamp: the next ones that differ "
            "are taken."
        )
    fault = "has no neighbour in its strip with another time stamp"
    block.demand("images", np.isfinite(velocity), fault, "correct time_s, or give vx, vy, vz")
    speed = np.linalg.norm(velocity, axis=1)
    sigma = speed * np.sqrt(2) * sigma_t / span
    return Velocities(velocity, sigma, method, step, sigma_t, notes)


def _smooth(time, position):
    """Velocity (n, 3) of a quadratic in time, and by how much each time stamp is late (n,), s."""
    count, t = len(time), time - time.mean()
    if count < 2 or np.ptp(t) <= 0:
        return np.full((count, 3), np.nan), np.full(count, np.nan)
    degree = 2 if count >= 8 else 1
    half = np.ptp(t) / 2
    found = polynomial.polyfit(t / half, position, degree)
    velocity = polynomial.polyval(t / half, polynomial.polyder(found)).T / half
    if count <= degree + 2:
        return velocity, np.full(count, np.nan)
    mean = velocity.mean(axis=0)
    residual = polynomial.polyval(t / half, found).T - position
    late = residual @ mean / max(mean @ mean, 1e-12)
    return velocity, late * np.sqrt(count / (count - degree - 1))


def _central(time, position):
    """Displacement over time between neighbours (n, 3), their distance in time (n,), s."""
    count = len(time)
    velocity, span, wider = np.full((count, 3), np.nan), np.full(count, np.nan), 0
    for n in range(count):
        before, after = max(n - 1, 0), min(n + 1, count - 1)
        while time[after] <= time[before] and (before > 0 or after < count - 1):
            before, after = max(before - 1, 0), min(after + 1, count - 1)
        wider += bool(
            (n > 0 and time[n - 1] == time[n]) or (n < count - 1 and time[n + 1] == time[n])
        )
        span[n] = time[after] - time[before]
        if span[n] > 0:
            velocity[n] = (position[after] - position[before]) / span[n]
    return velocity, span, wider


def times(block: Block) -> np.ndarray:
    """Seconds (images,). Raises InputError where an image has none."""
    time = block.column("images", "time_s")
    remedy = "fill it in, or give vx, vy, vz"
    block.demand("images", ~np.isnan(time), "has no time_s, from which velocities follow", remedy)
    return time


def _checked(block: Block, found: Velocities) -> Velocities:
    """Refuse what nothing can fly."""
    worst = int(np.argmax(found.speed))
    if found.speed[worst] > FASTEST_M_S:
        time = block.column("images", "time_s")[worst]
        many = int(np.sum(found.speed > FASTEST_M_S))
        raise InputError(
            f"{block.named('images', worst)} would fly {found.speed[worst]:.0f} m/s at time_s = "
            f"{time:g} ({many} of {len(found.speed)} images faster than {FASTEST_M_S:g} m/s): its "
            "time stamp or its flight and strip are wrong, correct them or give vx, vy, vz"
        )
    return found
