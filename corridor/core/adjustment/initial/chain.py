"""From image to image: poses by resection as far as known points reach, straightened on the way.

What is oriented is adjusted whenever it has grown. Without that a chain bends: an unknown k1 of
0.04 tilts each image by a degree against its neighbour.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd

from corridor.core.adjustment.initial.intersection import intersect_new
from corridor.core.adjustment.initial.network import CENTRE, GATES_PX, LEAST_INLIER_SHARE, Network
from corridor.core.block import POSE, Block
from corridor.core.engine.compiled import compiled
from corridor.core.geometry import (
    closed_pose,
    quaternion_from_rotation,
    refine_poses,
    relative_width,
    rotation_from_quaternion,
)

# Marks, or points of any kind, that orient an image.
FEWEST_MARKS, _FEWEST_POINTS = 4, 6
_SWEEPS = 4
# What is oriented is adjusted on the way whenever it has grown by this.
_GROWTH = 1.25


def resect_in_turn(
    network: Network, say: Callable[[str], None], enough: Callable[[], bool] = lambda: False
) -> None:
    """Resect images from known points, the best supported first, until none is left or enough."""
    count = len(network.images)
    seen_known = np.bincount(network.image, weights=network.known[network.point], minlength=count)
    tried = np.full(count, -1.0)
    adjusted = network.posed.sum()
    while not enough():
        support = np.where(network.posed | (seen_known <= 1.2 * tried), -1, seen_known)
        image = int(np.argmax(support))
        if support[image] < FEWEST_MARKS:
            return
        tried[image] = support[image]
        if not resect(network, image):
            continue
        points = network.point[network.rows(image)]
        before = network.known[points].copy()
        intersect_new(network, again=True, within=points)
        fresh = points[network.known[points] & ~before]
        _count(fresh, network.point_start, network.by_point, network.image, seen_known)
        total = int(network.posed.sum())
        if total % 100 == 0:
            say(f"start values: {total} of {count} images oriented")
        if total > _GROWTH * adjusted:
            adjust_interim(network)
            adjusted = total


@compiled()
def _count(points, point_start, by_point, image, counts):
    """Adds the rays of points to the counts of the images they come from."""
    for p in points:
        for n in range(point_start[p], point_start[p + 1]):
            counts[image[by_point[n]]] += 1


def resect(network: Network, image: int) -> bool:
    """Pose of one image from the known points it sees; False where they do not agree on one."""
    rows = np.arange(network.image_start[image], network.image_start[image + 1])
    rows = rows[network.known[network.point[rows]]]
    place, ray = network.place[network.point[rows]], np.ascontiguousarray(network.ray[rows])
    marks = int(network.ground[network.point[rows]].sum())
    if len(rows) < _FEWEST_POINTS and marks < FEWEST_MARKS:
        return False
    origin = place.mean(0)
    reach = np.abs(place - origin).max()
    if reach == 0 or relative_width(place) < 1e-3:
        return False
    near = np.ascontiguousarray((place - origin) / reach)
    for gate in [gate for gate in GATES_PX if gate >= network.gate]:
        found = closed_pose(near, ray, gate * network.pixel[image])
        if found is None:
            continue
        rotation, centre, agreeing = found
        if agreeing < (LEAST_INLIER_SHARE if gate < GATES_PX[-1] else 0.3):
            continue
        if agreeing * len(rows) < min(_FEWEST_POINTS, len(rows)):
            continue
        network.rotation[image], network.centre[image] = rotation, centre * reach + origin
        network.posed[image] = True
        network.gate = max(network.gate, gate)
        refine(network, np.array([image]))
        # Many marks know better than a GNSS that may be in another datum.
        if marks < FEWEST_MARKS and np.isfinite(network.antenna[image]).all():
            _hold(network, image)
        return True
    return False


def _hold(network: Network, image: int) -> None:
    """Take the centre of an image from GNSS, if it still sees its points from there."""
    free = network.rotation[image].copy(), network.centre[image].copy()
    before = network.agreement(image, GATES_PX[-1])
    network.held[image] = network.trusted[image] = True
    refine(network, np.array([image]))
    if network.agreement(image, GATES_PX[-1]) < LEAST_INLIER_SHARE * before:
        network.held[image] = network.trusted[image] = False
        network.rotation[image], network.centre[image] = free


def refine(network: Network, images: np.ndarray) -> None:
    """Poses of oriented images from the known points they see; a GNSS position stays."""
    at = images[network.held[images]]
    # The turn moves the arm, and with it the centre below the antenna.
    for _ in range(3 if len(at) else 1):
        arm = np.einsum("nij,ni->nj", network.rotation[at], network.arm[at])
        network.centre[at] = network.antenna[at] - arm
        refine_poses(
            images.astype(np.int64), network.rays, network.image_start, network.point,
            network.place, network.known, float(network.gate), network.held,
        )  # fmt: skip


def adjust_interim(network: Network) -> None:
    """Straighten the oriented part by an adjustment, or where that cannot be, by sweeps.

    It cannot where given poses or points must stay, or the part has no datum yet.
    """
    given = network.point_given & network.known & ~network.ground
    fixed = network.pose_given.any() or given.any()
    found = None if fixed else network.adjusted(_part(network))
    if found is None:
        sweep(network, np.flatnonzero(network.posed & ~network.pose_given))
        return
    pose = found.poses
    network.centre[network.posed] = pose[:, :3]
    network.rotation[network.posed] = rotation_from_quaternion(pose[:, 3:])
    row = pd.Index(network.points).get_indexer(found.points["point"])
    mine = ~network.point_given[row]
    network.place[row[mine]] = found.points[CENTRE].to_numpy()[mine]
    network.held[:] = False
    interior = [
        found.cameras[name].interior if name in found.cameras else before
        for name, before in zip(network.block.cameras, network.interior, strict=True)
    ]
    network.look_through(np.array(interior))
    intersect_new(network, again=True)


def sweep(network: Network, images: np.ndarray) -> None:
    """Poses of these images from the points and all points from the poses, a few times."""
    for _ in range(_SWEEPS):
        refine(network, images)
        intersect_new(network, again=True)


def _part(network: Network) -> Block:
    """The oriented images with the points that are known, as a block."""
    whole, posed = network.block, np.flatnonzero(network.posed)
    rows = np.flatnonzero(network.posed[network.image] & network.known[network.point])
    marked = network.ground[network.point[rows]]
    ties, marks = rows[~marked], rows[marked]

    def seen(rows: np.ndarray) -> pd.DataFrame:
        point, image = network.points[network.point[rows]], network.images[network.image[rows]]
        x, y = network.measured[rows].T
        return pd.DataFrame({"point": point, "image": image, "x": x, "y": y})

    images = whole.images.iloc[posed].filter(["image", "camera", "flight"]).reset_index(drop=True)
    turn = quaternion_from_rotation(network.rotation[posed])
    images[list(POSE)] = np.column_stack([network.centre[posed], turn])
    points = np.unique(network.point[ties])
    held = network.images[network.trusted & network.posed]
    flights = {"default", *images.get("flight", ())}
    return Block(
        name=whole.name,
        cameras={
            name: camera.with_interior(network.interior[k])
            for k, (name, camera) in enumerate(whole.cameras.items())
            if k in network.camera[posed]
        },
        images=images,
        tie_points=seen(ties),
        points=pd.DataFrame(network.place[points], columns=CENTRE).assign(
            point=network.points[points]
        ),
        marks=seen(marks),
        ground=whole.ground[whole.ground["point"].isin(network.points[network.point[marks]])],
        gnss=whole.gnss[whole.gnss["image"].isin(held)],
        sigma=whole.sigma,
        lever_arm={flight: arm for flight, arm in whole.lever_arm.items() if flight in flights},
        lever_arm_fixed=whole.lever_arm_fixed,
    )
