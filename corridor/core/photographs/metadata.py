"""What one photograph says of itself: EXIF and XMP, the more precise where both speak."""

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corridor.core.errors import InputError
from corridor.core.photographs import exif, maker_note, xmp
from corridor.core.photographs.exif import Taken
from corridor.core.photographs.opening import FAULTS, MOST_PIXELS, fault, open_picture

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".png")
# Pictures as a camera takes them, where a program that made them smaller struck EXIF's size.
_TAKEN = {("Sequoia", "perspective"): (4608, 3456)}
_SAME_SHAPE = 0.01


@dataclass(frozen=True)
class Metadata:
    """One photograph's metadata; None where it does not say.

    width, height_px: of the stored picture; written_size: what the camera wrote. pixels_per_mm: of
    the sensor, in pixels as taken. taken: by the camera's clock. lat_deg, lon_deg (WGS 84),
    height (m, as written: of the ellipsoid or the sea); exif_height: EXIF's, where XMP has one too.
    sigma: east, north, up, m. flag: DJI's quality. yaw, pitch, roll: degrees of the gimbal or the
    camera, as written: the yaw of some gimbals counts from the airframe's, `flight_yaw`, which
    counts from north. serial: of the body. temperature_c and what it is of. velocity: east, north,
    up, m/s, and what says so. apart_m: horizontally, from EXIF's position to
    XMP's. gyro: samples us, x, y, z (rad/s, axes of the maker). line_ns: time of a row as the
    header says. tags: every XMP entry as text.
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
    exif_height: float | None = None
    sigma: tuple[float, float, float] | None = None
    flag: int | None = None
    yaw: float | None = None
    pitch: float | None = None
    roll: float | None = None
    flight_yaw: float | None = None
    serial: str = ""
    temperature_c: float | None = None
    temperature_of: str = ""
    velocity: tuple[float, float, float] | None = None
    velocity_of: str = ""
    line_ns: float | None = None
    apart_m: float | None = None
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
    """Photographs of a folder and the folders in it, in order. Raises InputError without any.

    A raw picture (.dng) beside the same picture in another form is left out.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; name the folder of the photographs")
    found = sorted(
        file
        for file in folder.rglob("*")
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".") and file.is_file()
    )
    # Beside a picture its raw form may lie, called alike but for the ending.
    raw = {file for file in found if file.suffix.lower() == ".dng"}
    pictures = {file.with_suffix("") for file in found if file not in raw}
    found = [file for file in found if file not in raw or file.with_suffix("") not in pictures]
    if not found:
        others = sorted({file.suffix.lower() for file in folder.rglob("*") if file.suffix})
        has = f", but {', '.join(others[:5])}" if others else ""
        raise InputError(
            f"{folder} holds no photograph ({', '.join(SUFFIXES)}){has}; convert pictures to JPEG "
            "with their EXIF, or name another"
        )
    return found


def read_metadata(
    path: Path, content: bytes | None = None, most_pixels: int = MOST_PIXELS
) -> Metadata:
    """What a photograph says of itself.

    content: the bytes of the file, where they are at hand. most_pixels: as in `open_picture`.
    Raises InputError where it cannot be read.
    """
    try:
        source = path if content is None else io.BytesIO(content)
        with open_picture(source, most_pixels) as picture:
            width, height = picture.size
            facts, note, packet = exif.facts_of(picture)
            tags = xmp.tags_of(picture.info.get("xmp") or packet)
    except FAULTS as error:
        raise InputError(
            f"{path.name} cannot be read as a photograph ({fault(error)}); take it out "
            "of the folder"
        ) from None
    noted = maker_note.facts_of(note) if "dji" in facts["make"].lower() else {}
    told = xmp.facts_of(tags)
    for each in (facts, told):
        lat, lon = each.get("lat_deg"), each.get("lon_deg")
        if lat is None or lon is None:
            continue
        if abs(lat) > 90 or abs(lon) > 180 or (lat, lon) == (0.0, 0.0):
            each |= {"lat_deg": None, "lon_deg": None, "height": None}
    if told.get("lat_deg") is not None and facts.get("lat_deg") is not None:
        facts["apart_m"] = _apart(facts, told)
    if told.get("height") is not None:
        facts["exif_height"] = facts.get("height")
    # Of two that speak, XMP is the more precise.
    for more in (noted, told):
        facts |= {name: value for name, value in more.items() if value is not None}
    if facts.get("lat_deg") is None:
        facts["height"] = None
    return Metadata(path, width, height, tags=tags, **facts)


def _apart(one: dict, other: dict) -> float:
    """Metres between two positions, as on a sphere whose degree is 111 km."""
    north = other["lat_deg"] - one["lat_deg"]
    east = (other["lon_deg"] - one["lon_deg"]) * np.cos(np.radians(one["lat_deg"]))
    return float(111_195.0 * np.hypot(north, east))
