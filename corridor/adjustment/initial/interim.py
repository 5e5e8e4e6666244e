"""What is oriented so far, straightened before it grows on.

Without this a chain bends: an unknown k1 of 0.04 tilts each image by a degree against its
neighbour.
"""

import numpy as np
import pandas as pd

from corridor.adjustment.initial.intersection import intersect_new
from corridor.adjustment.initial.network import CENTRE, Network
from corridor.adjustment.initial.resection import refine
from corridor.block import POSE, Block
from corridor.geometry import quaternion_from_rotation, rotation_from_quaternion

_SWEEPS = 4


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
        return pd.DataFrame(
            {
                "point": network.points[network.point[rows]],
                "image": network.images[network.image[rows]],
                "x": network.measured[rows, 0],
                "y": network.measured[rows, 1],
            }
        )

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
