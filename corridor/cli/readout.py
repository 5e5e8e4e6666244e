"""Readout time of a rolling shutter from photographs of a star, a wheel or a blinking LED.

examples:
  corridor readout star STILL.jpg TURNING.jpg --turns-per-second 2.2 -o out/star
      a Siemens star at rest and turning, its speed from a sensor or a strobe
  corridor readout wheel STILL.jpg TURNING.jpg --video FILM.mp4 -o out/wheel
      a bicycle wheel; a film of it, by any camera from the same side, gives speed and sense
  corridor readout wheel BAR1.jpg BAR2.jpg --turns-per-second 3.679 --sense cw -o out/bar
      one bar turning in both photographs, smeared to a fan by a long exposure
  corridor readout led PHOTO.jpg --frequency 1000 -o out/led
      something evenly lit by a LED that blinks 1000 times a second

Give the photographs as the camera wrote them: not turned, cut or resized. An error of the speed
goes into the readout time one to one. OUT holds readout.json and readout.png; it appears when
both are written, or not at all.
"""

import argparse
import io
import math
import sys
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor readout`, one set for each target."""
    targets = parser.add_subparsers(title="targets", metavar="TARGET", dest="target", required=True)
    star = targets.add_parser("star", help="a Siemens star, at rest and turning")
    _two_photos(star)
    star.add_argument(
        "--turns-per-second", metavar="N", type=_positive, required=True, help="speed of the star"
    )
    star.add_argument(
        "--sectors",
        metavar="N",
        type=_sectors,
        help="black and white sectors together (default: counted)",
    )
    wheel = targets.add_parser("wheel", help="a bicycle wheel, or a bar smeared by its rotation")
    _two_photos(wheel)
    speed = wheel.add_mutually_exclusive_group(required=True)
    speed.add_argument("--turns-per-second", metavar="N", type=_positive, help="speed of the wheel")
    speed.add_argument(
        "--video", metavar="VIDEO", type=Path, help="film of the turning wheel from the same side"
    )
    wheel.add_argument(
        "--video-fps",
        metavar="F",
        type=_positive,
        help="frames a second, if the file states it wrongly (slow motion)",
    )
    wheel.add_argument(
        "--photo-time",
        metavar="T",
        type=_number,
        help="seconds after the first frame at which TURNING was taken (default: the middle)",
    )
    led = targets.add_parser("led", help="something lit by a LED blinking at a known frequency")
    led.add_argument("photo", metavar="PHOTO", type=Path, help="the photograph")
    led.add_argument(
        "--frequency", metavar="HZ", type=_positive, required=True, help="periods a second"
    )
    _common(led)


def _two_photos(parser):
    parser.add_argument("static", metavar="STATIC", type=Path, help="photograph of it at rest")
    parser.add_argument("rotating", metavar="ROTATING", type=Path, help="photograph of it turning")
    parser.add_argument(
        "--sense",
        choices=("cw", "ccw"),
        help="rotation as seen in the stored picture (default: found as far as it can be)",
    )
    parser.add_argument(
        "--camera",
        metavar="FILE",
        type=Path,
        help="calibration: a TOML file with one [camera.NAME] table, such as block.toml",
    )
    _common(parser)


def _common(parser):
    parser.add_argument(
        "--speed-sigma",
        metavar="PERCENT",
        type=_not_negative,
        default=0.0,
        help="standard error of the speed or frequency (default 0)",
    )
    parser.add_argument(
        "--row-direction",
        choices=("down", "up", "left", "right"),
        help="how rows follow each other in the stored picture (default: found)",
    )
    parser.add_argument(
        "-o", "--output", metavar="OUT", type=Path, required=True, help="folder for the result"
    )


def run(options: argparse.Namespace) -> None:
    """Measure, draw, save, and print what came of it."""
    from corridor import figures
    from corridor import readout as room
    from corridor.errors import InputError

    room.can_save_readout(options.output)
    if options.target == "wheel" and options.video is None:
        for option in ("video_fps", "photo_time"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} needs --video")
    print(f"measuring the {options.target} ...", file=sys.stderr, flush=True)
    readout = _measure(room, options)
    picture = io.BytesIO()
    figures.readout_picture(readout).savefig(
        picture, format="png", dpi=144, metadata={"Software": None}
    )
    pictures = {"readout": picture.getvalue()}
    written = room.save_readout(readout, options.output, pictures)
    print(readout)
    print("\nWrote", *written, sep="\n  ")


def _measure(room, options):
    if options.target == "led":
        return room.readout_from_led(
            options.photo,
            options.frequency,
            frequency_sigma_percent=options.speed_sigma,
            row_direction=options.row_direction,
        )
    known = {
        "speed_sigma_percent": options.speed_sigma,
        "sense": options.sense,
        "row_direction": options.row_direction,
        "camera": options.camera,
    }
    photos = options.static, options.rotating
    if options.target == "star":
        known["sectors"] = options.sectors
        return room.readout_from_star(*photos, options.turns_per_second, **known)
    return room.readout_from_wheel(
        *photos,
        options.turns_per_second,
        video=options.video,
        video_fps=options.video_fps,
        photo_time=options.photo_time,
        **known,
    )


def _number(text):
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def _positive(text):
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not greater than 0")
    return value


def _not_negative(text):
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is negative")
    return value


def _sectors(text):
    if not text.isdecimal() or int(text) < 6 or int(text) % 2:
        raise argparse.ArgumentTypeError(f"{text!r} is not an even number of sectors, 6 or more")
    return int(text)
