"""A block as Metashape's XML: cameras.xml, markers.xml, calibration_N.xml."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.geometry import rotation_from_quaternion
from corridor.core.gnss import (
    GEOCENTRIC,
    GEOGRAPHIC,
    about_the_middle,
    convert,
    known_crs,
    local_of,
)
from corridor.tools.formats.cameras import in_the_middle
from corridor.tools.formats.frames import moved
from corridor.tools.formats.hanging import Hanging
from corridor.tools.formats.rows import camera_positions
from corridor.tools.formats.textfile import add_xml, write_xml

_LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'


def write(block: Block, folder: Path, name: str) -> None:
    """Write cameras.xml (poses and references), markers.xml and calibration_NAME.xml."""
    if block.crs is not None and local_of(block) is None:
        # The transform of a chunk that has a system is geocentric: a grid has none.
        block = moved(block, about_the_middle(block), block.crs)
    frame = _Frame(block)
    write_xml(_cameras_xml(block, frame), folder / "cameras.xml")
    if len(block.marks) or len(block.ground):
        write_xml(_markers_xml(block, frame), folder / "markers.xml")
    for number, camera in enumerate(block.cameras.values()):
        root = ElementTree.Element("calibration")
        add_xml(root, "projection", "fisheye" if camera.fisheye else "frame")
        for key in ("width", "height"):
            add_xml(root, key, str(getattr(camera, key)))
        _interior_xml(root, camera)
        write_xml(root, folder / f"calibration_{number}.xml")


class _Frame:
    """The system that is written: the one that the block's results are given in, else latitude and
    longitude where it has a place on Earth."""

    def __init__(self, block: Block):
        self.local = local_of(block)
        self.crs = block.extra["local_frame"].get("crs", GEOGRAPHIC) if self.local else None
        self.wkt = _LOCAL
        if self.crs is not None:
            system = known_crs(self.crs)
            flat = system if system.is_compound else system.to_2d()
            self.wkt = flat.to_wkt("WKT1_GDAL")
        self.turn, self.shift = np.eye(3), block.offset
        if self.local:
            self.turn = self.local.rotation().T
            self.shift = convert(
                self.local.to_geographic(np.zeros((1, 3))), GEOGRAPHIC, GEOCENTRIC
            )[0]

    def reference(self, parent, place, sigma, enabled: bool) -> None:
        """Add the reference of a measured place (3,), sigma (3,)."""
        place = np.asarray(place, dtype=float)[None]
        local = self.local
        x, y, z = (place + self.shift if local is None else local.to_crs(place, self.crs))[0]
        sigma = "/".join(repr(float(value)) for value in sigma)
        on = "true" if enabled else "false"
        add_xml(parent, "reference", x=x, y=y, z=z, sxyz=sigma, enabled=on)


def _interior_xml(parent, camera):
    cx, cy = in_the_middle(camera.width, camera.height)
    f = camera["f"]
    add_xml(parent, "f", f)
    add_xml(parent, "cx", camera["cx"] - cx)
    add_xml(parent, "cy", camera["cy"] - cy)
    for key in ("b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2"):
        if camera[key]:
            add_xml(parent, key, camera[key] * (f if key in ("b1", "b2") else 1.0))


def _document_xml(block):
    """Root, chunk, and the elements of the cameras of a document without poses.

    Sensors of a rig name that of its base, and where they hang in its frame; cameras name their
    master, which alone is posed.
    """
    root = ElementTree.Element("document", {"version": "2.0.0"})
    chunk = add_xml(root, "chunk", label=block.name, enabled="true")
    sensors = add_xml(chunk, "sensors", next_id=str(len(block.cameras)))
    number = {name: str(k) for k, name in enumerate(block.cameras)}
    hanging = Hanging.of(block)
    members = hanging.members()
    for camera in block.cameras.values():
        size = {"width": str(camera.width), "height": str(camera.height)}
        kind = "fisheye" if camera.fisheye else "frame"
        sensor = add_xml(sensors, "sensor", id=number[camera.name], label=camera.name, type=kind)
        add_xml(sensor, "resolution", **size)
        if camera.pixel_um:
            for key in ("pixel_width", "pixel_height"):
                add_xml(sensor, "property", name=key, value=camera.pixel_um / 1000)
        calibration = add_xml(sensor, "calibration", type=kind, **{"class": "adjusted"})
        add_xml(calibration, "resolution", **size)
        _interior_xml(calibration, camera)
        if camera.name in members:
            sensor.set("master_id", number[hanging.base[camera.name]])
            add_xml(sensor, "rotation", *members[camera.name].rotation.T.ravel())
            add_xml(sensor, "location", *members[camera.name].place)
    cameras = add_xml(chunk, "cameras", next_id=str(len(block.images)), next_group_id="0")
    names = block.images["camera"].tolist()
    for k, (image, first) in enumerate(zip(block.images["image"], hanging.together, strict=True)):
        element = add_xml(cameras, "camera", id=str(k), sensor_id=number[names[k]], label=image)
        if first != k and names[first] == hanging.base[names[k]]:
            element.set("master_id", str(first))
    return root, chunk, cameras


def _cameras_xml(block, frame):
    root, chunk, cameras = _document_xml(block)
    positions = camera_positions(block).set_index("image")
    pose = block.poses
    rotation = rotation_from_quaternion(np.nan_to_num(pose[:, 3:], nan=1.0))
    for k, (element, image) in enumerate(zip(cameras, block.images["image"], strict=True)):
        if np.isfinite(pose[k]).all() and element.get("master_id") is None:
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = rotation[k].T, pose[k, :3]
            add_xml(element, "transform", *matrix.ravel())
        if image in positions.index:
            mine = positions.loc[image, ["x", "y", "z", "sx", "sy", "sz"]].to_numpy(float)
            frame.reference(element, mine[:3], mine[3:], True)
    add_xml(chunk, "reference", frame.wkt)
    transform = add_xml(chunk, "transform")
    add_xml(transform, "rotation", *frame.turn.ravel())
    add_xml(transform, "translation", *frame.shift)
    add_xml(transform, "scale", "1")
    return root


def _markers_xml(block, frame):
    root, chunk, _ = _document_xml(block)
    ground = block.ground.set_index("point")
    places = ground[["x", "y", "z"]].to_numpy(float)
    sigmas = block.ground_sigma()
    marked = block.marks["point"].cat.categories
    names = list(dict.fromkeys([*ground.index, *marked]))
    markers = add_xml(chunk, "markers", next_id=str(len(names)), next_group_id="0")
    for k, name in enumerate(names):
        element = add_xml(markers, "marker", id=str(k), label=name)
        if k < len(ground):
            frame.reference(element, places[k], sigmas[k], ground["role"].iloc[k] == "control")
    if len(block.distances):
        bars = add_xml(chunk, "scalebars", next_id=str(len(block.distances)), next_group_id="0")
        sigma = block.column("distances", "sigma")
        for k, (one, other, length) in enumerate(
            block.distances[["from", "to", "distance"]].itertuples(index=False)
        ):
            if {one, other} <= set(names):
                bar = add_xml(bars, "scalebar", id=str(k), label=f"{one}_{other}")
                for end in (one, other):
                    add_xml(bar, "endpoint", marker_id=str(names.index(end)))
                known = {"sd": float(sigma[k])} if np.isfinite(sigma[k]) else {}
                add_xml(bar, "reference", d=float(length), **known, enabled="true")
    frames = add_xml(chunk, "frames", next_id="1")
    found = add_xml(add_xml(frames, "frame", id="0"), "markers")
    image = block.image_rows("marks")
    point = pd.Index(names).get_indexer(marked)[block.marks["point"].cat.codes]
    pixels = block.marks[["x", "y"]].to_numpy() + 0.5
    for k in np.unique(point):
        element = add_xml(found, "marker", marker_id=str(k))
        for row in np.flatnonzero(point == k):
            x, y = pixels[row]
            add_xml(element, "location", camera_id=str(image[row]), pinned="true", x=x, y=y)
    add_xml(chunk, "reference", frame.wkt)
    return root
