"""The block with what it leaves open filled in."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core.adjustment.initial.chain import resect_in_turn
from corridor.core.adjustment.initial.intersection import intersect_all, intersect_new
from corridor.core.adjustment.initial.network import CENTRE, Network
from corridor.core.adjustment.initial.submodel import orient_submodel
from corridor.core.block import POSE, Block
from corridor.core.geometry import quaternion_from_rotation
from corridor.core.output import Progress, telling


def complete(
    block: Block,
    adjusted: Callable[[Block], Block | None],
    progress: Callable[[Progress], None] | None = None,
) -> Block:
    """The block with every pose and every point filled in; what is given is kept as it is.

    Ground points with coordinates (role control or check) orient images by their marks. Points
    without coordinates, tie points and measured ones that ground.csv lacks, get a row in `points`.
    adjusted: a part of the block adjusted on the way, None where it cannot be.
    progress: called with a `Progress`.

    With no pose, no ground point and no antenna position the frame is free: the mean view looks
    down, the cameras' centre is the origin, and the median distance of a camera to its neighbour
    is 1.
    Raises InputError naming the images that cannot be oriented, and the remedy.
    """
    network = Network(block, adjusted)
    if network.posed.all() and (network.known | network.spare).all():
        return block
    if not network.posed.all():
        _orient(network, telling(progress))
    intersect_all(network)
    return replace(block.copy(), images=_images(block, network), points=_points(block, network))


def _orient(network: Network, say: Callable[[str], None]) -> None:
    while True:
        intersect_new(network)
        resect_in_turn(network, say)
        if network.posed.all():
            return
        orient_submodel(network, say)


def _images(block: Block, network: Network) -> pd.DataFrame:
    if network.pose_given.all():
        return block.images.copy()
    pose = np.column_stack([network.centre, quaternion_from_rotation(network.rotation)])
    found = {
        name: np.where(network.pose_given, block.column("images", name), value)
        for name, value in zip(POSE, pose.T, strict=True)
    }
    return block.images.assign(**found)


def _points(block: Block, network: Network) -> pd.DataFrame:
    """The table of points with its empty cells filled, and new rows at its end."""
    points, new = block.points.copy(), ~network.point_given
    found = pd.DataFrame(network.place[new], columns=CENTRE)
    found.insert(0, "point", network.points[new])
    if not len(points):
        return found if len(found) else points
    row = pd.Index(points["point"]).get_indexer(found["point"])
    listed = row >= 0
    place = points[CENTRE].to_numpy(copy=True)
    place[row[listed]] = network.place[new][listed]
    points[CENTRE] = place
    return pd.concat([points, found[~listed]], ignore_index=True) if not listed.all() else points
