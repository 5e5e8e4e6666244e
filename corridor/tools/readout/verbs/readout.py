"""Readout time of a rolling shutter from a survey flight, a star, a wheel or a blinking LED.

examples:
  corridor readout flight BLOCK -o out/flight
      from an ordinary survey, with the velocities of its images or what they can be derived from,
      and with rates.csv, the turns that a gyroscope recorded
  corridor readout flight PHOTOS --model "DJI FC330" -o out/flight
      from a folder of photographs, which are imported to out/flight_block first
  corridor readout star STILL.jpg TURNING.jpg --turns-per-second 2.2 -o out/star
      a Siemens star at rest and turning, its speed from a sensor or a strobe
  corridor readout wheel STILL.jpg TURNING.jpg --video FILM.mp4 -o out/wheel
      a bicycle wheel; a film of it, by any camera from the same side, gives speed and sense
  corridor readout wheel BAR1.jpg BAR2.jpg --turns-per-second 3.679 --sense cw -o out/bar
      one bar turning in both photographs, smeared to a fan by a long exposure
  corridor readout examples -o out/photos
      photographs to try it with, of known readout times, and the commands that measure them
  corridor readout led PHOTO.jpg --frequency 1000 -o out/led
      something evenly lit by a LED that blinks 1000 times a second

Give photographs of a target as the camera wrote them: not turned, cut or resized. An error of the
speed goes into the readout time one to one. OUT holds readout.json and readout.png; it appears
when both are written, or not at all. A flight determines it where its images were taken at
several speeds in the camera's frame: strips both ways with one heading, cross strips, slow or
hovering photographs at the ends of strips; or where a gyroscope saw the camera rock. Its sigma is
the formal one, or what leaving out one strip in turn shows, where that is larger than chance makes
it; OUT holds report.html too. Where it does not determine the readout time, the status is 1, and
report.html and refused.json say why, and which four photographs would determine it.
"""

import argparse
from pathlib import Path

from corridor.core.command.options import (
    Bars,
    checked,
    digits,
    kinds,
    number,
    option,
    picked,
    say,
    whole,
    wrote,
)

_sectors = checked(
    digits, lambda v: v >= 6 and v % 2 == 0, "is not an even number of sectors, 6 or more"
)
_positive = number("is not a number greater than 0", above=0.0)
_TURNS = {"metavar": "N", "type": _positive}
_COMMON = {
    "--speed-sigma": option(
        "standard error of the speed or frequency (default 0)",
        "PERCENT",
        number("is not a number from 0", least=0.0),
        default=0.0,
    ),
    "--row-direction": option(
        "how rows follow each other in the stored picture (default: found)",
        choices=("down", "up", "left", "right"),
    ),
    "--output": option("folder for the result", required=True),
}
_TWO_PHOTOS = {
    "static": option("photograph of it at rest", "STATIC", Path),
    "rotating": option("photograph of it turning", "ROTATING", Path),
    "--sense": option(
        "rotation as seen in the stored picture (default: found as far as it can be)",
        choices=("cw", "ccw"),
    ),
    "--camera": option(
        "calibration: a TOML file with one [camera.NAME] table, such as block.toml", "FILE", Path
    ),
    **_COMMON,
}
_STAR = {
    **_TWO_PHOTOS,
    "--turns-per-second": _TURNS | option("speed of the star", required=True),
    "--sectors": option("black and white sectors together (default: counted)", "N", _sectors),
}
_WHEEL = {
    **_TWO_PHOTOS,
    "--video-fps": option(
        "frames a second, if the file states it wrongly (slow motion)", "F", _positive
    ),
    "--photo-time": option(
        "seconds after the first frame at which TURNING was taken (default: the middle)",
        "T",
        number("is not a number"),
    ),
    "--turns-per-second": _TURNS | option("speed of the wheel", one_of="exactly"),
    "--video": option(
        "film of the turning wheel from the same side", "VIDEO", Path, one_of="exactly"
    ),
}
_LED = {
    "photo": option("the photograph", "PHOTO", Path),
    "--frequency": option("periods a second", "HZ", _positive, required=True),
    **_COMMON,
}
_MADE = {"--output": option("folder for the photographs", "FOLDER", required=True)}
_FLIGHT = {
    "source": option("a block, or a folder of photographs", "BLOCK_OR_PHOTOS", Path),
    "--model": option(
        "make and model of the camera, for published values (photographs: by EXIF)", "NAME"
    ),
    "--size": option(
        "photographs: reduce larger pictures to this many pixels along the long side",
        "PIXELS",
        whole("number of pixels", 100),
    ),
    "--share": option("photographs: take every N-th only", "N", whole("share", 1)),
    "--iterations": {"default": 200}
    | option("iterations within which the adjustment has to converge (default %(default)s)"),
    "--output": option("folder for the result", required=True),
}


_TARGETS = {
    "flight": (
        "an ordinary survey: a block, or its photographs",
        _FLIGHT,
        """
BLOCK -o out/flight
PHOTOS --size 1200 -o out/flight
""",
    ),
    "star": (
        "a Siemens star, at rest and turning",
        _STAR,
        """
STILL.jpg TURNING.jpg --turns-per-second 2.2 -o out/star
STILL.jpg TURNING.jpg --turns-per-second 2.2 --speed-sigma 0.1 --camera block.toml -o out/star
""",
    ),
    "wheel": (
        "a bicycle wheel, or a bar smeared by its rotation",
        _WHEEL,
        """
STILL.jpg TURNING.jpg --turns-per-second 1.5 --sense cw -o out/wheel
STILL.jpg TURNING.jpg --video FILM.mp4 -o out/wheel
""",
    ),
    "led": (
        "something lit by a LED blinking at a known frequency",
        _LED,
        "PHOTO.jpg --frequency 1000 -o out/led",
    ),
    "examples": ("make photographs to try the others with", _MADE, "-o out/photos"),
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Options of `corridor readout`, one set for each target."""
    kinds(parser, "readout", "targets", "target", _TARGETS)


def run(options: argparse.Namespace) -> None:
    """Measure, draw, save, and print what came of it."""
    from corridor.core import registry
    from corridor.core.errors import InputError
    from corridor.tools import readout as room

    if options.target == "flight":
        _flight(room, options)
        return
    if options.target == "examples":
        wrote(*room.write_examples(options.output))
        print("\nWhat they show, and how to measure it:")
        for example in room.EXAMPLES:
            print(f"  {example.readout_ms:g} ms  {example.command(options.output)}")
        return
    room.can_save_readout(options.output)
    if options.target == "wheel" and options.video is None:
        for option in ("video_fps", "photo_time"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} needs --video")
    say(f"measuring the {options.target} ...")
    readout = _measure(room, options)
    figures = registry.room("figures")
    pictures = {"readout": figures.png(figures.readout_picture(readout))}
    written = room.save_readout(readout, options.output, pictures)
    print(readout)
    wrote(*written)


def _measure(room, options):
    if options.target == "led":
        return room.readout_from_led(
            options.photo,
            options.frequency,
            frequency_sigma_percent=options.speed_sigma,
            row_direction=options.row_direction,
        )
    known = picked(options, "sense row_direction camera")
    known["speed_sigma_percent"] = options.speed_sigma
    photos = options.static, options.rotating
    if options.target == "star":
        known["sectors"] = options.sectors
        return room.readout_from_star(*photos, options.turns_per_second, **known)
    return room.readout_from_wheel(
        *photos,
        options.turns_per_second,
        **picked(options, "video video_fps photo_time"),
        **known,
    )


def _flight(room, options):
    from corridor.core.errors import ReadoutFailed

    room.can_save_flight(options.output)
    block, model = _block(options)
    with Bars() as progress:
        found = room.readout_from_flight(
            block, model=options.model or model, max_iterations=options.iterations,
            progress=progress,
        )  # fmt: skip
    written = room.save_flight(found, options.output)
    print(found)
    wrote(*written)
    if not found.told:
        raise ReadoutFailed(f"this flight does not determine the readout time. {found.reasons[0]}")


def _block(options):
    """The block to look at, imported first where photographs are given; make and model by EXIF."""
    from corridor.core import registry
    from corridor.core.block import read
    from corridor.core.errors import InputError
    from corridor.core.photographs import photographs_in, read_metadata

    source = options.source
    photos = []
    if source.is_dir() and not (source / "block.toml").exists():
        photos = photographs_in(source)
    if not photos:
        for name in ("size", "share"):
            if getattr(options, name) is not None:
                raise InputError(f"--{name} is for photographs, and {source} holds none")
        return read(source), ""
    first = read_metadata(photos[0])
    output = options.output.with_name(f"{options.output.name}_block")
    formats = registry.room("formats")
    added = formats.Additions(long_side=options.size, share=options.share or 1)
    formats.import_project(source, "photos", output, added=added, progress=say)
    wrote(output)
    return read(output), f"{first.make} {first.model}".strip()
