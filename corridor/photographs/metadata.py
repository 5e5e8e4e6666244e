"""What one photograph says of itself: EXIF and XMP, the more precise where both speak."""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from corridor.errors import InputError
from corridor.photographs import maker_note, xmp
from corridor.photographs.exif import Exif, Taken

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png")
# Pictures as a camera takes them, where a program that made them smaller struck EXIF's size.
_TAKEN = {("Sequoia", "perspective"): (4608, 3456)}
_SAME_SHAPE = 0.01
# What Pillow raises on damaged files.
_FAULTS = (
    UnidentifiedImageError, OSError, SyntaxError, ValueError, KeyError, TypeError, IndexError,
    OverflowError, AttributeError, struct.error, Image.DecompressionBombError,
)  # fmt: skip


@dataclass(frozen=True)
class Metadata:
    """One photograph's metadata; None where it does not say.

    width, height_px: of the stored picture; written_size: what the camera wrote. pixels_per_mm: of
    the sensor, in pixels as taken. taken: by the
    camera's clock. lat_deg, lon_deg (WGS 84), height (m, as written: of the ellipsoid or the sea).
    sigma: east, north, up, m. flag: DJI's quality. yaw, pitch, roll: degrees of the gimbal or the
    camera, as written. temperature_c and what it is of. velocity: east, north, up, m/s, and what
    says so. gyro: samples us, x, y, z (rad/s, axes of the maker); created_s: seconds since start
    at the first row. line_ns: time of a row as the header says. tags: every XMP entry as text.
    """

    path: Path
    width: int
    height_px: int
    make: str = ""
    model: str = ""
    orientation: int = 1
    written_size: tuple[int, int] | None = None
    exposure_s: float | None = None
    focal_mm: float | None = None
    focal_35_mm: float | None = None
    pixels_per_mm: float | None = None
    taken: Taken | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    height: float | None = None
    sigma: tuple[float, float, float] | None = None
    flag: int | None = None
    yaw: float | None = None
    pitch: float | None = None
    roll: float | None = None
    temperature_c: float | None = None
    temperature_of: str = ""
    velocity: tuple[float, float, float] | None = None
    velocity_of: str = ""
    line_ns: float | None = None
    created_s: float | None = None
    gyro: np.ndarray | None = None
    tags: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """File name."""
        return self.path.name

    @property
    def taken_size(self) -> tuple[int, int]:
        """Width and height as the camera took it, px: of the sensor's rows, however it is stored.

        Told by EXIF, or known of the model, where that has the shape of the stored picture and is
        larger; else the stored size.
        """
        known = _TAKEN.get((self.model, self.tags.get("ModelType", "perspective")))
        for size in (self.written_size, known):
            if size is None or size[0] <= self.width:
                continue
            if abs(size[0] * self.height_px / (size[1] * self.width) - 1) < _SAME_SHAPE:
                return size
        return self.width, self.height_px

    @property
    def resized(self) -> bool:
        """Whether the picture was made smaller after it was taken."""
        return self.taken_size != (self.width, self.height_px)

    def number(self, *names: str) -> float | None:
        """The first finite number among the XMP entries of these names."""
        return xmp.number(self.tags, *names)


def photographs_in(folder: Path) -> list[Path]:
    """Photographs of a folder and the folders in it, in order. Raises InputError without any."""
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; name the folder of the photographs")
    found = sorted(
        file
        for file in folder.rglob("*")
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
    )
    if not found:
        raise InputError(f"{folder} holds no photograph ({', '.join(SUFFIXES)}); name another")
    return found


def read_metadata(path: Path, content: bytes | None = None) -> Metadata:
    """What a photograph says of itself.

    content: the bytes of the file, where they are at hand.
    Raises InputError where it cannot be read.
    """
    try:
        with Image.open(path if content is None else io.BytesIO(content)) as picture:
            size = picture.size
            exif = Exif(picture)
            packet = picture.info.get("xmp") or exif.xmp
    except _FAULTS as error:
        raise InputError(
            f"{path.name} cannot be read as a photograph ({type(error).__name__}); take it out of "
            "the folder"
        ) from None
    tags = xmp.tags_of(packet)
    lat, lon, height = _position(xmp.position(tags), exif.position)
    yaw, pitch, roll = xmp.attitude(tags)
    flag = xmp.number(tags, "RtkFlag")
    temperature, temperature_of = xmp.temperature(tags)
    if temperature is None and exif.ambient_c is not None:
        temperature, temperature_of = exif.ambient_c, "AmbientTemperature"
    velocity, velocity_of = xmp.velocity(tags)
    noted = maker_note.floats_of(exif.maker_note) if "dji" in exif.make.lower() else {}
    if velocity is None:
        velocity, velocity_of = maker_note.velocity(noted)
    if yaw is None:
        yaw, pitch, roll = maker_note.attitude(noted)
    return Metadata(
        path=path,
        width=size[0],
        height_px=size[1],
        make=exif.make,
        model=exif.model,
        orientation=exif.orientation,
        written_size=exif.written_size,
        exposure_s=exif.exposure_s,
        focal_mm=exif.focal_mm,
        focal_35_mm=exif.focal_35_mm,
        pixels_per_mm=exif.pixels_per_mm,
        taken=exif.taken,
        lat_deg=lat,
        lon_deg=lon,
        height=height,
        sigma=xmp.sigma(tags),
        flag=int(flag) if flag is not None else None,
        yaw=yaw,
        pitch=pitch,
        roll=roll,
        temperature_c=temperature,
        temperature_of=temperature_of,
        velocity=velocity,
        velocity_of=velocity_of,
        line_ns=xmp.number(tags, "LineReadoutTime"),
        created_s=exif.since_start_s,
        gyro=xmp.gyroscope(tags),
        tags=tags,
    )


def _position(of_xmp, of_exif):
    lat, lon, height = of_xmp
    if lat is None or lon is None:
        lat, lon = of_exif[:2]
    if height is None:
        height = of_exif[2]
    if lat is None or lon is None or abs(lat) > 90 or abs(lon) > 180 or (lat, lon) == (0.0, 0.0):
        return None, None, None
    return lat, lon, height
