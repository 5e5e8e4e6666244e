"""What is measured, as arrays in the order in which the kernels run over it."""

from dataclasses import dataclass

import numpy as np

from corridor.core.adjustment.ordering import (
    appearances,
    bandwidth,
    corridor_order,
    first_and_same,
    pixels_of_rows,
    sorted_rows,
)
from corridor.core.adjustment.rigs import lots
from corridor.core.block import Block, exposures_of, independent, is_among, level_axes, values_of
from corridor.core.effects import Images
from corridor.core.errors import InputError
from corridor.core.output import counted

# Coordinates of ground points known no better than this are worse start values than a result, m.
VAGUE_M = 1.0


@dataclass
class Network:
    """Image observations sorted by point and image, points by their images, images by place.

    order (m,): image row of each position. ptr (n + 1,), img, row (k,), xy (k, 2), weight (k,) or
    (1,): observations of point i are ptr[i] to ptr[i + 1]; row counts ties first, then marks, of
    which tie_count are ties. skewed (k, 3), or (0, 3) where x and y of all are equally good and
    independent: what makes them so, 00 10 11 of a lower triangle. point_codes (n,): category of
    tie_points, or of marks counted on;
    point_kinds (n,): True where the point is a mark. point_start (n, 3), m.
    exposure (m,): number of the exposure of each image; one that hangs with no other has its own.
    bandwidth: in exposures.
    """

    order: np.ndarray
    ptr: np.ndarray
    img: np.ndarray
    xy: np.ndarray
    weight: np.ndarray
    skewed: np.ndarray
    row: np.ndarray
    tie_count: int
    point_codes: np.ndarray
    point_kinds: np.ndarray
    point_start: np.ndarray
    exposure: np.ndarray
    bandwidth: int

    @property
    def point_of_ray(self) -> np.ndarray:
        """Position (k,) of the point of each observation."""
        return np.repeat(np.arange(len(self.ptr) - 1), np.diff(self.ptr))


@dataclass
class Control:
    """Ground control that images show.

    control (n,): of each point, row of the arrays here, or -1. control_rows (c,): rows of
    ground.csv. control_given (c, 3), m. control_turn (c, 3, 3): what makes their coordinates
    independent (`block.independent`), and control_weight (c, 3), 1/m^2, of what that gives.
    """

    control: np.ndarray
    control_rows: np.ndarray
    control_given: np.ndarray
    control_turn: np.ndarray
    control_weight: np.ndarray


@dataclass
class Gnss:
    """Known antenna positions: image (k,), position (k, 3), m; turn and weight as of `Control`."""

    gnss_image: np.ndarray
    gnss_given: np.ndarray
    gnss_turn: np.ndarray
    gnss_weight: np.ndarray


NO_GNSS = Gnss(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)))


@dataclass
class Attitudes:
    """Known attitudes: image (k,), rotation world to camera (k, 3, 3), and what turns residuals in
    the camera frame into those about level axes (k, 3, 3), of weight (k, 3), 1/rad^2."""

    attitude_image: np.ndarray
    attitude_given: np.ndarray
    attitude_level: np.ndarray
    attitude_weight: np.ndarray


def _starts_of_marks(block: Block) -> np.ndarray:
    """Start coordinates (points, 3) of marked points: of points.csv where the ground's are vague.

    An adjustment that starts from the result of another stays where that one came to rest.
    """
    starts = block.positions("marks")
    vague = block.ground.loc[(block.ground_sigma() > VAGUE_M).any(axis=1), "point"]
    if not len(vague):
        return starts
    rows = block.points[is_among(block.points["point"], vague)]
    at = block.marks["point"].dtype.categories.get_indexer(rows["point"])
    xyz = values_of(rows, *"xyz")
    known = (at >= 0) & np.isfinite(xyz).all(axis=1)
    starts[at[known]] = xyz[known]
    return starts


def network_of(block: Block, images: Images, control: set[str], unused: set[str]) -> Network:
    """Observations sorted by point and image, points by their images, images by place."""
    tie, mark = block.tie_points, block.marks
    tie_names = tie["point"].dtype.categories
    mark_names = mark["point"].dtype.categories
    codes = [rows["point"].array.codes.astype(np.int32, copy=False) for rows in (tie, mark)]
    count = len(tie_names) + len(mark_names)
    xyz = np.concatenate([block.positions("tie_points"), _starts_of_marks(block)])
    skip = np.array([name in unused for name in mark_names], dtype=bool)
    kept = np.flatnonzero(~skip[codes[1]])
    point = _joined(codes[0], codes[1][kept] + np.int32(len(tie_names)))
    image = _joined(
        block.image_rows("tie_points", np.int32), block.image_rows("marks", np.int32)[kept]
    )
    del codes
    multiplicity = appearances(point, count)
    _check_multiplicity(block, multiplicity, control, tie_names, mark_names)
    _check_images(block, image, images)

    lot, rigs = lots(block), len(exposures_of(block).member) > 0
    of_ray = lot.astype(np.int32)[image] if rigs else image
    place = np.argsort(corridor_order(point, of_ray, xyz, int(lot.max(initial=-1)) + 1))[lot]
    # Images of one exposure stand together.
    order = np.argsort(place, kind="stable")
    exposure = place[order]
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order))
    # Points that the same images see belong together: the kernel gathers them.
    first, same = first_and_same(point, image, rank, count)
    by_first = np.lexsort((same, first))
    used = multiplicity[by_first] > 0
    codes = by_first[used]
    ptr = np.concatenate([[0], np.cumsum(multiplicity[codes])])
    start = np.zeros(count, dtype=np.int64)
    start[codes] = ptr[:-1]
    img, row = sorted_rows(point, image, rank, start)
    of_marks = row >= len(tie)
    row[of_marks] = len(tie) + kept[row[of_marks] - len(tie)]
    del point, image, of_marks
    pixels = (one[axis].to_numpy(float) for one in (tie, mark) for axis in "xy")
    xy = pixels_of_rows(row, *(np.ascontiguousarray(axis) for axis in pixels))
    weight = _weights(block, row)
    kinds = codes >= len(tie_names)
    return Network(
        order=order,
        ptr=ptr,
        img=img,
        xy=xy,
        weight=weight,
        skewed=_skewed(block, row),
        row=row,
        tie_count=len(tie),
        point_codes=codes,
        point_kinds=kinds,
        point_start=np.ascontiguousarray(xyz[codes]),
        exposure=exposure,
        bandwidth=bandwidth(ptr, exposure[img] if rigs else img),
    )


def control_of(block: Block, network: Network, rows: np.ndarray) -> tuple[Control, list[str]]:
    """The control of rows of ground.csv, and a sentence where some of it is in no image.

    Control that no image shows adds nothing and would count as observation.
    """
    names = block.ground["point"].to_numpy(dtype=object)[rows]
    marks = block.marks["point"].dtype.categories.to_numpy(dtype=object)
    first = len(block.tie_points["point"].dtype.categories)
    shown = set(marks[network.point_codes[network.point_kinds] - first])
    measured = np.array([name in shown for name in names], dtype=bool)
    notes = []
    if not measured.all():
        left = names[~measured]
        notes.append(
            f"Control point{'s' if len(left) > 1 else ''} {', '.join(left[:10])} "
            f"{'are' if len(left) > 1 else 'is'} not measured in any image and not used."
        )
    rows = rows[measured]
    at = {name: n for n, name in enumerate(names[measured])}
    of_point = np.full(len(network.point_codes), -1, np.int64)
    kinds = network.point_kinds
    of_point[kinds] = [at.get(name, -1) for name in marks[network.point_codes[kinds] - first]]
    given = block.numbers("ground", *"xyz")[rows]
    turn, sigma = independent(block.ground_sigma()[rows], block.correlation("ground")[rows])
    return Control(of_point, rows, given, turn, sigma**-2.0), notes


def gnss_of(block: Block, rank: np.ndarray) -> Gnss:
    """The antenna positions of a block. rank (m,): position of each row of images.csv."""
    if not len(block.gnss):
        return NO_GNSS
    given = block.numbers("gnss", *"xyz")
    known = np.isfinite(given).all(axis=1)
    image = rank[block.image_rows("gnss")]
    turn, sigma = independent(block.gnss_sigma()[known], block.correlation("gnss")[known])
    return Gnss(image[known], given[known], turn, sigma**-2.0)


def attitudes_of(block: Block, rank: np.ndarray) -> Attitudes:
    """The attitudes of a block. rank (m,): position of each row of images.csv."""
    given = block.attitude_rotations
    known = np.isfinite(given).all(axis=(1, 2))
    given = given[known]
    image = rank[block.image_rows("attitudes")[known]]
    weight = block.attitude_sigma()[known] ** -2.0
    return Attitudes(image, given, level_axes(given) @ given.transpose(0, 2, 1), weight)


def _weights(block: Block, row: np.ndarray) -> np.ndarray:
    """Root of the weight of the observations in these rows, or the one (1,) that all have."""
    sigmas = [sigma for sigma in (block.tie_sigma(), block.mark_sigma()) if len(sigma)]
    if len(row) and all(sigma.strides == (0,) and sigma[0] == sigmas[0][0] for sigma in sigmas):
        return 1.0 / sigmas[0][:1]
    weight = 1.0 / _joined(block.tie_sigma(), block.mark_sigma())[row]
    return weight[:1].copy() if len(weight) and np.all(weight == weight[0]) else weight


def _skewed(block: Block, row: np.ndarray) -> np.ndarray:
    """`Network.skewed` of the observations in these rows."""
    tables = {table: block.in_pictures(table) for table in ("tie_points", "marks")}
    if all(both is None for both in tables.values()):
        return np.zeros((0, 3))
    out = []
    for table, both in tables.items():
        if both is None:
            out.append(np.tile([1.0, 0.0, 1.0], (len(getattr(block, table)), 1)))
            continue
        turn, sigma = independent(*both)
        turn *= (np.sqrt(sigma.prod(axis=1))[:, None] / sigma)[:, :, None]
        out.append(turn[:, [0, 1, 1], [0, 0, 1]])
    found = np.concatenate(out)[row]
    return found if (found != [1.0, 0.0, 1.0]).any() else np.zeros((0, 3))


def _joined(ties: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Ties, then marks; not copied where there are no marks."""
    return np.concatenate([ties, marks]) if len(marks) else ties


def _check_multiplicity(block, multiplicity, control, tie_names, mark_names) -> None:
    """Refuse points that one image alone shows, unless their coordinates are given."""
    single = multiplicity == 1
    for table, names, offset in (
        ("tie_points", tie_names, 0),
        ("marks", mark_names, len(tie_names)),
    ):
        alone = np.flatnonzero(single[offset : offset + len(names)])
        if table == "marks":
            alone = np.array([n for n in alone if names[n] not in control], dtype=int)
        if len(alone) == 0:
            continue
        row = np.flatnonzero(np.isin(getattr(block, table)["point"].cat.codes, alone))[0]
        name = getattr(block, table)["point"].iloc[row]
        more = f" ({len(alone) - 1} more points too)" if len(alone) > 1 else ""
        raise InputError(
            f"{block.where(table, row)}: point {name} is seen in one image only{more}: measure it "
            "in a second image or remove the row"
        )


def _check_images(block: Block, image: np.ndarray, images: Images) -> None:
    """Refuse images with too few points to have a pose."""
    count = appearances(image, len(images.names))
    few = np.flatnonzero(count < 3)
    if len(few):
        more = f" ({len(few) - 1} more images have too few)" if len(few) > 1 else ""
        points = counted(int(count[few[0]]), "measured point")
        raise InputError(
            f"{block.where('images', few[0])}: image {images.names[few[0]]} has {points}, a pose "
            f"needs 3{more}: measure more or remove the image"
        )
