"""From the pieces that a format found to a project: the step that all formats share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.block import Block
from corridor.camera import Camera
from corridor.errors import InputError
from corridor.gnss import Local
from corridor.interchange.cameras import NoModel
from corridor.interchange.project import (
    Project,
    images_table,
    local_table,
    observations_table,
    points_table,
    rotations_to_columns,
    same_point_once,
)
from corridor.interchange.rows import rows_of


@dataclass
class Views:
    """Where points are seen: one row an observation.

    point (m,): into names. image (m,): into the images. pixels (m, 2). what: the format's word.
    """

    point: np.ndarray
    names: Sequence[str] | pd.Index
    image: np.ndarray
    pixels: np.ndarray
    what: str = "observations"

    @classmethod
    def of(
        cls, rows: Sequence[tuple[str, int, float, float]], what: str = "observations"
    ) -> Views | None:
        """Of rows (name of the point, row of the image, x, y); None without any."""
        if not rows:
            return None
        names, image, x, y = zip(*rows, strict=True)
        codes, known = pd.factorize(np.array(names, dtype=object))
        return cls(
            codes, pd.Index(known, dtype="str"), np.array(image), np.column_stack([x, y]), what
        )

    def in_images(self, keep: np.ndarray) -> Views:
        """Those in the images that are kept (n,), numbered anew."""
        mine = keep[self.image]
        return replace(
            self,
            point=self.point[mine],
            image=(np.cumsum(keep) - 1)[self.image[mine]],
            pixels=self.pixels[mine],
        )

    def table(self, images: Sequence[str], warnings: list[str]) -> pd.DataFrame:
        """tie_points.csv or marks.csv; a second view of a point in one image is left out."""
        table = observations_table(self.point, self.names, self.image, images, self.pixels)
        return same_point_once(table, self.what, warnings)


@dataclass
class Pieces:
    """What a format found, before it is a block.

    cameras: by name; a NoModel in the place of one leaves its images out. images, used: names of
    the images and of the camera of each. centre (n, 3), rotation (n, 3, 3), world to camera; NaN
    where an image has no pose. columns: more of images.csv. ties, marks: what is seen of points.
    points: names and places (p, 3), or None: where the rays of the ties meet. ground, gnss: as in
    a block. local: the east, north, up frame of the coordinates.
    """

    name: str
    cameras: dict[str, Camera | NoModel]
    images: list[str]
    used: Sequence[str]
    centre: np.ndarray
    rotation: np.ndarray
    columns: dict = field(default_factory=dict)
    ties: Views | None = None
    marks: Views | None = None
    points: tuple[Sequence[str] | pd.Index, np.ndarray] | None = None
    ground: pd.DataFrame | None = None
    gnss: pd.DataFrame | None = None
    local: Local | None = None
    offset: np.ndarray | None = None
    crs: str | None = None
    description: str = ""
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def project(self, form: str, source: Path, **more) -> Project:
        """The project; more: further fields of it. Raises InputError where a pose is none."""
        self = self._of_known_cameras(source)
        known = np.isfinite(self.rotation).all(axis=(1, 2))
        quaternion = np.full((len(known), 4), np.nan)
        quaternion[known] = rotations_to_columns(self.rotation[known])
        used = set(self.used)
        block = Block(
            name=self.name,
            cameras={name: camera for name, camera in self.cameras.items() if name in used},
            images=images_table(self.images, self.used, self.centre, quaternion, **self.columns),
            tie_points=self.ties and self.ties.table(self.images, self.warnings),
            marks=self.marks and self.marks.table(self.images, self.warnings),
            points=self.points and points_table(*self.points),
            ground=self.ground,
            gnss=self.gnss,
            offset=np.zeros(3) if self.offset is None else self.offset,
            crs=self.crs,
            description=self.description,
            extra={} if self.local is None else {"local_frame": local_table(self.local)},
        )
        if set(block.ground["point"]) | set(block.marks["point"].cat.categories):
            block = apart(block, self.notes)
        if self.points is None and self.ties is not None:
            block = replace(block, points=_met(block))
            self.notes.append(
                f"{form} has no coordinates of tie points: they were intersected from the rays"
            )
            lost = len(block.tie_points["point"].cat.categories) - len(block.points)
            if lost:
                self.warnings.append(
                    f"{lost} tie points have no coordinates: their rays do not meet"
                )
        return Project(form, source, block, notes=self.notes, warnings=self.warnings, **more)

    def _of_known_cameras(self, source: Path) -> Pieces:
        """The pieces without the images of cameras for which there is no model, which are told."""
        strange = {k: why for k, why in self.cameras.items() if isinstance(why, NoModel)}
        if not strange:
            return self
        keep = np.array([name not in strange for name in self.used], dtype=bool)
        if not keep.any():
            raise InputError(f"{source}: {next(iter(strange.values()))}; nothing is left to import")
        for name, why in strange.items():
            lost = [
                image for image, used in zip(self.images, self.used, strict=True) if used == name
            ]
            if lost:
                first = ", ".join(lost[:5])
                self.warnings.append(f"{why}: its {len(lost)} images were left out ({first})")
        images = [image for image, kept in zip(self.images, keep, strict=True) if kept]
        return replace(
            self,
            images=images,
            used=[name for name in self.used if name not in strange],
            centre=self.centre[keep],
            rotation=self.rotation[keep],
            columns={name: np.asarray(values)[keep] for name, values in self.columns.items()},
            ties=self.ties and self.ties.in_images(keep),
            marks=self.marks and self.marks.in_images(keep),
            gnss=None if self.gnss is None else self.gnss[self.gnss["image"].isin(images)],
        )


def apart(block: Block, notes: list[str], more: Iterable[str] = ()) -> Block:
    """The block whose tie points have other names than its ground points and `more`.

    Numbers name tie points and ground points alike in many programs.
    """
    ties = block.tie_points["point"].cat.categories
    taken = {*block.ground["point"], *block.marks["point"].cat.categories, *more}
    if not ties.isin(taken).any():
        return block
    notes.append("tie points got a t before their names, which ground points have too")
    table = block.tie_points.assign(
        point=block.tie_points["point"].cat.rename_categories(("t" + ties).astype("str"))
    )
    names = block.points["point"]
    points = block.points.assign(point=names.where(~names.isin(ties), "t" + names))
    return replace(block, tie_points=table, points=points)


def _met(block: Block) -> pd.DataFrame:
    rows = rows_of(block, complete=False)
    good = np.isfinite(rows.positions).all(axis=1)
    good[rows.ties :] = False
    return points_table(rows.point_names[good], rows.positions[good])
