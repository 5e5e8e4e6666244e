"""Speed of a turning wheel from a film of it.

From frame to frame the light on circles about the axis turns by one angle. Its harmonics are
compared: the spokes' own decide finely, whatever tells one spoke from the next (valve, reflector,
label) decides by how many spokes. A rolling shutter bends the spokes of every frame alike and
does not matter, nor does a tilt: errors repeat with every turn.
"""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.geometry import robust_scale
from corridor.tools.readout.fitting import vertex
from corridor.tools.readout.lens import Unknown
from corridor.tools.readout.photograph import CannotMeasure
from corridor.tools.readout.star import meeting_points
from corridor.tools.readout.turning import Known
from corridor.tools.readout.wheel_view import directions, poses_of, rim_about

_SMALL = 640  # px
_FRAMES = 900  # at most, from the start
_RINGS = np.linspace(0.3, 0.97, 12)
_SAMPLES = 720
_ORDER = np.arange(1, 151)  # of the harmonics of a ring
_LEAST_TURNS = 1.5  # turns: fewer hardly tell the speed from errors that repeat with every turn
_REPEATS = math.radians(1.5), math.radians(0.5)  # their usual size, once and twice a turn


@dataclass(frozen=True)
class Speed:
    """Turns a second (positive), its standard error, the sense, and the time it holds for."""

    turns_per_second: float
    sigma: float
    sense: str
    time_s: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Film:
    """A film of the turning wheel, its frames a second where the file states them wrongly, and the
    moment of the photograph, seconds after the first frame; see `speed_from_video`."""

    video: str | os.PathLike | None = None
    video_fps: float | None = None
    photo_time: float | None = None


def known_from_film(known: Known, film: Film) -> Known:
    """What is known, with the speed and the sense of a film.

    Raises InputError where the film contradicts the sense, and as `speed_from_video`.
    """
    speed = speed_from_video(film.video, fps=film.video_fps, photo_time=film.photo_time)
    if known.sense not in (None, speed.sense):
        raise InputError(
            f"sense {known.sense} contradicts {film.video}, in which the wheel turns "
            f"{speed.sense}: correct one of the two, or film from the side that the photograph was "
            "taken from"
        )
    own = 100 * speed.sigma / speed.turns_per_second
    return replace(
        known,
        turns_per_second=speed.turns_per_second,
        speed_sigma_percent=math.hypot(known.speed_sigma_percent, own),
        sense=speed.sense,
        warnings=speed.warnings,
    )


@one_thread()
def speed_from_video(
    path: str | os.PathLike, *, fps: float | None = None, photo_time: float | None = None
) -> Speed:
    """Speed of the wheel in a film.

    fps: frames a second, where the file states it wrongly. photo_time: seconds after the first
    frame for which the speed is wanted; None: the middle of the film.
    Raises InputError where the film cannot be read or photo_time is outside it, CannotMeasure
    where no turning wheel is seen in it or its speed is ambiguous.
    """
    path = Path(path)
    frames, times = _read(path, fps)
    if photo_time is not None and not 0 <= photo_time <= times[-1]:
        raise InputError(
            f"photo time {photo_time:g} s is outside {path.name}, which lasts {times[-1]:.2f} s"
        )
    rings = _rings(frames, path.name)
    waves = _waves(rings)
    step, weight = _step(waves, path.name)
    angles = _angles(waves, step, weight)
    angles, warnings = _which_spoke(waves, angles, path.name)
    time = photo_time if photo_time is not None else times[-1] / 2
    omega, sigma = _slope(times, angles, time)
    turned = abs(angles[-1] - angles[0])
    sigma = math.hypot(sigma, math.radians(0.3) / max(turned, 1e-9) * abs(omega))
    if turned < math.radians(20) or abs(omega) < 5 * sigma:
        raise CannotMeasure(f"the wheel in {path.name} does not turn")
    turns = turned / (2 * math.pi)
    if turns < _LEAST_TURNS:
        warnings += (
            f"{path.name} shows {turns:.1f} turns of the wheel, from which its speed follows to "
            f"{100 * sigma / abs(omega):.1g} % only: film two turns or more",
        )
    sense, turn = "cw" if omega > 0 else "ccw", 2 * math.pi
    return Speed(abs(omega) / turn, sigma / turn, sense, time, warnings)


def _read(path, fps):
    if not path.is_file():
        raise InputError(f"{path}: there is no such video")
    film = cv2.VideoCapture(str(path))
    try:
        stated = film.get(cv2.CAP_PROP_FPS)
        if fps is None and not (np.isfinite(stated) and 1 <= stated <= 2000):
            if not film.isOpened():
                raise InputError(f"{path} is no film that can be read: give an MP4, MOV or AVI")
            raise InputError(f"{path} does not state its frame rate: give --video-fps")
        frames, stamps = [], []
        while len(frames) < _FRAMES:
            good, frame = film.read()
            if not good:
                break
            stamps.append(film.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
            grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame
            factor = min(1.0, _SMALL / max(grey.shape))
            if factor < 1:
                grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            frames.append(grey)
    finally:
        film.release()
    if len(frames) < 10:
        raise InputError(f"{path} is not a video of ten frames or more that can be read")
    rate = fps or stated
    times = np.arange(len(frames)) / rate
    stamps = np.array(stamps) - stamps[0]
    steps = np.diff(stamps)
    # Phones film at a rate that varies; the stamps know, unless they were left at zero.
    if fps is None and np.all(steps > 0) and np.ptp(steps) > 0.2 / rate:
        times = stamps
    return np.array(frames), times


def _rings(frames, name):
    """Changes of light (frames, rings, samples) on circles about the wheel's axis."""
    some = frames[:: max(1, len(frames) // 60)].astype(np.float32)
    mean, change = some.mean(axis=0), cv2.GaussianBlur(some.std(axis=0), (0, 0), 2.0)
    if np.quantile(change, 0.98) < np.median(change) + 1.0 and np.quantile(change, 0.98) < 4.0:
        raise CannotMeasure(f"nothing turns in {name}")
    y, x = np.nonzero(change > 0.5 * np.quantile(change, 0.995))
    middle = np.array([np.median(x), np.median(y)])
    best = None
    # The mean of all frames shows the rim without the spokes, a single one where they meet.
    for centre in [middle, *meeting_points(frames[len(frames) // 2].astype(np.float32), 6)]:
        rim = rim_about(mean, centre)
        if rim is not None and rim[1] > 0.6:
            inside = np.hypot(*(np.stack([x, y], axis=1) - rim[2].mean(axis=0)).T)
            reach = np.hypot(*(rim[2] - rim[2].mean(axis=0)).T).mean()
            score = rim[0] * float((inside < 1.1 * reach).mean())
            if best is None or score > best[0]:
                best = (score, rim[2])
    if best is None:
        raise CannotMeasure(f"{name} shows no rim of a turning wheel")
    lens = Unknown(frames.shape[2], frames.shape[1])
    tried = []
    # A circle seen as an ellipse has two tilts; about the right axis the light only turns.
    for pose in poses_of(best[1], lens):
        for focal in (0.7, 1.0, 1.6, 8.0):
            one = _tilted(pose, focal, best[1])
            rings = _sampled(frames[:: max(1, len(frames) // 40)], one)
            tried.append((_turning(rings), one))
    _, pose = max(tried, key=lambda one: one[0])
    return _sampled(frames, pose)


def _tilted(pose, focal, points):
    """The pose that goes with another focal length, its tilt kept near."""
    other = Unknown(*pose.lens.size, focal * pose.lens.focal)
    return max(poses_of(points, other), key=lambda one: float(np.dot(one.tilt, pose.tilt)))


def _sampled(frames, pose):
    at = pose.on_circles(_RINGS[:, None], directions(_SAMPLES)).astype(np.float32)
    edge = cv2.BORDER_REPLICATE
    rings = np.stack([cv2.remap(f, at, None, cv2.INTER_LINEAR, borderMode=edge) for f in frames])
    rings = rings.astype(np.float32)
    return rings - rings.mean(axis=0)


def _waves(rings):
    """Harmonics (frames, rings, orders) of the light on circles."""
    return np.fft.rfft(rings, axis=2)[:, :, _ORDER]


def _turns(angles):
    """What turns by angles (n,) do to harmonics (n, orders)."""
    return np.exp(1j * np.outer(angles, _ORDER))


def _turning(rings):
    """Share of the changes of light that one turn from frame to frame explains."""
    waves = _waves(rings)
    cross = (waves[1:] * np.conj(waves[:-1])).sum(axis=(0, 1))
    return float((_turns(directions(4096)) @ cross).real.max() / (np.abs(waves) ** 2).sum())


def _step(waves, name):
    """Angle from a frame to the next, radians, but for some spokes; weights (rings, harmonics)."""
    cross = (waves[1:] * np.conj(waves[:-1])).sum(axis=0)
    power = (np.abs(waves) ** 2).sum(axis=0) + 1e-9
    # What is unlike between frames is noise; every harmonic counts by what is like.
    share = np.abs(cross) / (power + 1e-4 * power.max())
    share = np.where(share > 3 / math.sqrt(len(waves)), share, 0)
    if not np.any(share):
        raise CannotMeasure(f"the frames of {name} do not show one turning wheel")
    angle = directions(8192) - np.pi
    score = _turns(angle) @ (share * np.exp(1j * np.angle(cross))).sum(axis=0)
    return float(angle[np.argmax(score.real)]), share / (power / len(waves))


def _angles(waves, step, weight):
    """Angle (frames,) of the wheel against the first frame, by steps and then as one."""
    fine = np.linspace(-1, 1, 201) * 0.05
    turns = _turns(fine)

    def best(cross, about):
        score = (turns @ (cross * np.exp(1j * _ORDER * about)).sum(axis=0)).real
        k = int(np.clip(np.argmax(score), 1, len(fine) - 2))
        return about + fine[k] + float(vertex(*score[k - 1 : k + 2])) * (fine[1] - fine[0])

    angles = np.zeros(len(waves))
    recent = [step] * 5
    for k in range(1, len(waves)):
        cross = waves[k] * np.conj(waves[k - 1]) * weight
        found = best(cross, float(np.median(recent)))
        recent = [*recent[1:], found]
        angles[k] = angles[k - 1] + found
    for _ in range(3):
        mean = (waves * np.exp(1j * _ORDER * angles[:, None, None])).mean(axis=0)
        against = np.conj(mean) * weight
        new = np.array([best(w * against, a) for w, a in zip(waves, angles, strict=True)])
        change, angles = np.max(np.abs(new - angles)), new
        if change < 1e-4:
            break
    return angles


def _which_spoke(waves, angles, name):
    """The angles with the right number of spokes a frame, and warnings.

    Spokes are alike; a valve, a reflector or a spoke that is not quite like the others is in its
    place after every turn only if the right number is taken.
    """
    count, length, order = len(waves), 8192, _ORDER
    turns = _turns(angles)
    together = np.abs((waves * turns[:, None, :]).mean(axis=0)) ** 2
    strength = together.sum(axis=0)
    strong = order[np.argsort(-strength)[: count // 3]]
    strong = strong[strength[strong - 1] > 0.02 * strength.max()]
    # What alike spokes do to the light, also where the background is uneven, tells nothing.
    alike, _ = np.linalg.qr(np.exp(-1j * angles[:, None] * strong))
    flat = waves.reshape(count, -1)
    rest = (flat - alike @ (alike.conj().T @ flat)).reshape(waves.shape)
    power = (np.abs(rest) ** 2).sum(axis=0)
    lines = np.abs(np.fft.fft(rest * turns[:, None, :], length, axis=0)) ** 2
    # Circles and harmonics count by what stands out of their noise: a few know the valve.
    lines = (lines / (count * (power + 1e-3 * power.max()))).sum(axis=1)
    extra = np.arange(-20000, 20001) * (np.pi / 20000)
    index = np.round(-extra[:, None] * order * (length / (2 * np.pi))).astype(np.int64) % length
    score = lines[index, np.arange(len(order))].sum(axis=1)
    # The spokes themselves must stay together, whatever the number of them a frame.
    own = strength[strong - 1] @ np.cos(strong[:, None] * extra)
    score = np.where(own > 0.7 * strength[strong - 1].sum(), score, 0.0)
    best = int(np.argmax(score))
    mean = float(np.median(np.diff(angles)))
    extra = (extra + mean + np.pi) % (2 * np.pi) - np.pi - mean
    far = np.abs((extra - extra[best] + np.pi) % (2 * np.pi) - np.pi) > 0.05
    rival = score[far].max()
    floor = np.median(score[score > 0])
    chance = 4 * math.sqrt(waves.shape[1] * len(order)) / count
    frames = np.arange(count)
    if score[best] - rival > max(chance, 0.02 * (score[best] - floor)):
        return angles + extra[best] * frames, ()
    alike = np.flatnonzero(score > rival - chance)
    steps = (mean + extra[alike] + np.pi) % (2 * np.pi) - np.pi
    slowest = int(alike[np.argmin(np.abs(steps))])
    others = np.abs(steps[np.abs(extra[alike] - extra[slowest]) > 0.05])
    if not len(others) or others.min() < 3 * np.abs(steps).min():
        raise CannotMeasure(
            f"the wheel in {name} looks the same after every few spokes, so its speed is "
            "ambiguous: mark one spoke or the tyre, or film more frames a second"
        )
    return angles + extra[slowest] * frames, (
        "no mark distinguishes the spokes of the film: the slowest of the possible speeds was "
        "taken",
    )


def _slope(times, angles, at):
    """Angular velocity at a time and its sigma, from a parabola or, where it is worth it, more.

    Axis and tilt are a little off, which repeats with every turn: a film of few turns hardly tells
    that from the speed, and what it does not tell goes into the sigma.
    """
    best = None
    scale = max(times[-1] / 2, 1e-9)
    x = (times - at) / scale
    waves = [wave(k * angles) for k in (1, 2) for wave in (np.cos, np.sin)]
    usual = 1 / np.repeat(_REPEATS, 2) ** 2
    for degree in (1, 2, 3):
        if len(times) < 4 * degree + 8:
            break
        design = np.column_stack([np.vander(x, degree + 1, increasing=True), *waves])
        weights, noise = np.ones(len(x)), math.radians(0.1)
        for _ in range(6):
            normal = design.T @ (design * weights[:, None]) / noise**2
            normal[degree + 1 :, degree + 1 :] += np.diag(usual)
            inverse = np.linalg.inv(normal)
            found = inverse @ (design.T @ (weights * angles)) / noise**2
            rest = angles - design @ found
            weights = 1 / np.maximum(1, np.abs(rest) / (3 * robust_scale(rest) + 1e-9))
            cost = (weights * rest**2).sum() / (len(x) - degree - 3)
            # Errors repeat from turn to turn: a good part of them is common to neighbours.
            noise = max(2 * math.sqrt(cost), 1e-6)
        if best is None or cost < 0.8 * best[0]:
            best = (cost, found[1] / scale, math.sqrt(inverse[1, 1]) / scale)
    return best[1], best[2]
