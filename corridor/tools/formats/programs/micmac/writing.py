"""A block as MicMac's files: orientations, calibrations, ground points, marks, tie points."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.tools.formats.columns import grouped, in_rows, text_of_rows
from corridor.tools.formats.rows import camera_positions, rows_of
from corridor.tools.formats.textfile import add_xml, write_xml

M2C = "eConvApero_DistM2C"
RADIAL = 8


def write(block: Block, folder: Path, name: str) -> None:
    """Write Ori-Corridor/, Homol/ (text), and XML of ground points and marks."""
    rows = rows_of(block)
    ori = folder / "Ori-Corridor"
    ori.mkdir()
    files = {name: f"AutoCal_{_plain(name)}.xml" for name in block.cameras}
    for name, camera in block.cameras.items():
        write_xml(_calibration_xml(camera), ori / files[name])
    for k, (image, camera) in enumerate(zip(rows.image_names, block.images["camera"], strict=True)):
        if "/" in image:
            raise InputError(
                f"image {image!r} lies in a folder, which MicMac does not allow; rename the images"
            )
        path = ori / f"Orientation-{image}.xml"
        write_xml(_orientation_xml(rows, k, f"Ori-Corridor/{files[camera]}"), path)
    ground, sigma = block.ground, block.ground_sigma()
    if len(ground):
        # A negative uncertainty is MicMac's way of saying "not for the adjustment".
        sign = np.where(ground["role"] == "control", 1.0, -1.0)[:, None]
        places = ground[["x", "y", "z"]].to_numpy(float)
        write_xml(_places_xml(ground["point"], places, sign * sigma), folder / "GroundPoints.xml")
    if len(block.marks):
        write_xml(_marks_xml(block), folder / "GroundMarks.xml")
    positions = camera_positions(block)
    if len(positions):
        (folder / "GNSS").mkdir()
        places, sigma = (
            positions[[*names]].to_numpy(float) for names in (("x", "y", "z"), ("sx", "sy", "sz"))
        )
        root = _places_xml(positions["image"], places, sigma)
        write_xml(root, folder / "GNSS" / "Centres-GNSS.xml")
    if len(block.tie_points):
        _write_ties(rows, len(block.tie_points), folder / "Homol")


def _plain(name):
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)


def _nested(parent, *tags):
    for tag in tags:
        parent = add_xml(parent, tag)
    return parent


def _calibration_xml(camera):
    root = ElementTree.Element("ExportAPERO")
    inner = add_xml(root, "CalibrationInternConique")
    point, f = (camera["cx"], camera["cy"]), camera["f"]
    add_xml(inner, "KnownConv", M2C)
    add_xml(inner, "PP", *point)
    add_xml(inner, "F", f)
    add_xml(inner, "SzIm", str(camera.width), str(camera.height))
    model = _nested(inner, "CalibDistortion", "ModPhgrStd")
    radial = add_xml(model, "RadialePart")
    add_xml(radial, "CDist", *point)
    k = [camera[f"k{n}"] for n in range(1, RADIAL + 1)]
    while len(k) > 3 and k[-1] == 0.0:
        k.pop()
    for n, value in enumerate(k, start=1):
        add_xml(radial, "CoeffDist", value / f ** (2 * n))
    add_xml(radial, "PPaEqPPs", "true")
    for key in ("p1", "p2"):
        add_xml(model, key.upper(), camera[key] / f)
    for key in ("b1", "b2"):
        add_xml(model, key, camera[key])
    return root


def _orientation_xml(rows, k, calibration):
    root = ElementTree.Element("ExportAPERO")
    element = add_xml(root, "OrientationConique")
    affine = add_xml(element, "OrIntImaM2C")
    for tag, pair in (("I00", "0 0"), ("V10", "1 0"), ("V01", "0 1")):
        add_xml(affine, tag, pair)
    add_xml(element, "TypeProj", "eProjStenope")
    add_xml(element, "ZoneUtileInPixel", "true")
    add_xml(element, "FileInterne", calibration)
    add_xml(element, "RelativeNameFI", "true")
    outer = add_xml(element, "Externe")
    add_xml(outer, "KnownConv", M2C)
    add_xml(outer, "Centre", *rows.centre[k])
    coded = _nested(outer, "ParamRotation", "CodageMatr")
    for tag, line in zip(("L1", "L2", "L3"), rows.rotation[k].T, strict=True):
        add_xml(coded, tag, *line)
    add_xml(add_xml(element, "ConvOri"), "KnownConv", M2C)
    return root


def _places_xml(names, places, sigmas):
    root = ElementTree.Element("DicoAppuisFlottant")
    for name, place, sigma in zip(names, places, sigmas, strict=True):
        part = add_xml(root, "OneAppuisDAF")
        add_xml(part, "Pt", *place)
        add_xml(part, "NamePt", name)
        add_xml(part, "Incertitude", *sigma)
    return root


def _marks_xml(block):
    root = ElementTree.Element("SetOfMesureAppuisFlottants")
    for image, table in block.marks.groupby("image", observed=True, sort=False):
        picture = add_xml(root, "MesureAppuiFlottant1Im")
        add_xml(picture, "NameIm", str(image))
        for row in table.itertuples(index=False):
            part = add_xml(picture, "OneMesureAF1I")
            add_xml(part, "NamePt", str(row.point))
            add_xml(part, "PtIm", row.x, row.y)
    return root


def _write_ties(rows, count, folder):
    """Every pair of images with common points, both ways, as MicMac's own text export has it."""
    image, point = rows.image[:count], rows.point[:count]
    words = in_rows(*rows.pixels[:count].T)
    by_point, points = grouped(point, rows.ties)
    views = np.diff(points)
    by_image, images = grouped(image, len(rows.image_names))
    for i, name in enumerate(rows.image_names):
        mine = by_image[images[i] : images[i + 1]]
        mine = mine[np.argsort(point[mine], kind="stable")]
        # Each of its observations beside all the views of the same point.
        many = views[point[mine]]
        before = np.repeat(points[point[mine]] - np.cumsum(many) + many, many)
        left, right = np.repeat(mine, many), by_point[before + np.arange(len(before))]
        order = np.argsort(image[right], kind="stable")
        left, right = (side[order][image[right][order] != i] for side in (left, right))
        if not len(left):
            continue
        text, starts = text_of_rows(words.take(left), " ", words.take(right), "\n")
        others, first = np.unique(image[right], return_index=True)
        place = folder / f"Pastis{name}"
        place.mkdir(parents=True)
        for j, start, end in zip(others, starts[first], starts[[*first[1:], -1]], strict=True):
            (place / f"{rows.image_names[j]}.txt").write_bytes(text[int(start) : int(end)])
