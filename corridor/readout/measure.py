"""Readout time from photographs: star, wheel, turning bar, blinking LED; published values."""

from __future__ import annotations

import os
from dataclasses import replace

from corridor.errors import InputError
from corridor.photographs import compared
from corridor.readout.lens import read_camera
from corridor.readout.photograph import Photograph, read
from corridor.readout.result import Readout


def readout_from_star(
    static: str | os.PathLike | Photograph,
    rotating: str | os.PathLike | Photograph,
    turns_per_second: float,
    *,
    camera: str | os.PathLike | None = None,
    **known,
) -> Readout:
    """Readout time from two photographs of a Siemens star, at rest and turning.

    static, rotating: files, or photographs that have been read.
    camera: TOML file with its calibration. known: speed_sigma_percent, sense, row_direction,
    sectors, as `corridor readout star` has them.
    Raises InputError where the input is wrong, CannotMeasure where the pictures do not show it.
    """
    from corridor.readout.star import measure_star

    photos = read(static), read(rotating)
    calibration = read_camera(camera) if camera else None
    return _compared(
        measure_star(*photos, turns_per_second, camera=calibration, **known), photos[1]
    )


def readout_from_wheel(
    static: str | os.PathLike | Photograph,
    rotating: str | os.PathLike | Photograph,
    turns_per_second: float | None = None,
    *,
    video: str | os.PathLike | None = None,
    video_fps: float | None = None,
    photo_time: float | None = None,
    camera: str | os.PathLike | None = None,
    sense: str | None = None,
    speed_sigma_percent: float = 0.0,
    **known,
) -> Readout:
    """Readout time from two photographs of a bicycle wheel, or of a bar smeared by its rotation.

    turns_per_second or video: the speed, or a film of the wheel from the same side that gives
    speed and sense. Other arguments and errors as `readout_from_star`.
    """
    from corridor.readout.wheel import measure_wheel

    if (turns_per_second is None) == (video is None):
        raise InputError("give either the turns a second or a video of the turning wheel")
    photos = read(static), read(rotating)
    calibration = read_camera(camera) if camera else None
    warnings = ()
    if video is not None:
        from corridor.readout.video import speed_from_video

        speed = speed_from_video(video, fps=video_fps, photo_time=photo_time)
        if sense is not None and sense != speed.sense:
            raise InputError(
                f"sense {sense} contradicts {video}, in which the wheel turns {speed.sense}: "
                "correct one of the two, or film from the side the photograph was taken from"
            )
        sense, warnings = speed.sense, speed.warnings
        turns_per_second = speed.turns_per_second
        own = 100 * speed.sigma / speed.turns_per_second
        speed_sigma_percent = (speed_sigma_percent**2 + own**2) ** 0.5
    found = measure_wheel(
        *photos,
        turns_per_second,
        camera=calibration,
        sense=sense,
        speed_sigma_percent=speed_sigma_percent,
        **known,
    )
    return _compared(replace(found, warnings=(*warnings, *found.warnings)), photos[1])


def readout_from_led(
    photo: str | os.PathLike | Photograph, frequency_hz: float, **known
) -> Readout:
    """Readout time from a photograph of something lit by a LED blinking at a known frequency.

    known: frequency_sigma_percent, row_direction. Errors as `readout_from_star`.
    """
    from corridor.readout.led import measure_led

    picture = read(photo)
    return _compared(measure_led(picture, frequency_hz, **known), picture)


def _compared(readout, photo):
    """The result with what others have published of the camera, as far as EXIF names it."""
    found, warning = compared(photo.make, photo.model, readout.readout_ms)
    if not found:
        return readout
    published = sorted({row.readout_ms for row in found})
    warnings = (*readout.warnings, warning) if warning else readout.warnings
    extra = {**readout.extra, "published_ms": published}
    return replace(readout, warnings=warnings, extra=extra)
