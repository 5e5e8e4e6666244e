"""[rig.NAME] of block.toml: cameras that are fixed to each other and expose together.

    [rig.HEAD]
    base = "nadir"                      # the camera whose pose is the rig's

    [rig.HEAD.member.left]              # another camera
    xyz = [0.10, 0.0, 0.02]             # its centre in the base camera's frame, m
    quaternion = [0.92, 0.0, 0.38, 0.0] # qw, qx, qy, qz: from the base camera to it
    sigma_m = 0.001                     # how well these are known: one number or three;
    sigma_deg = 0.05                    # 0: exactly; left out: not at all

Images that were taken together have the same text in the column `exposure` of images.csv. Where
xyz and quaternion are left out, what the start poses say on average stands in for them.

    C_m = C_b + R_b' t,   R_m = M R_b     with t, M the mounting
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core.block.tables import POSE
from corridor.core.errors import InputError
from corridor.core.geometry import (
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from corridor.core.textfile import is_number

EXPOSURE = "exposure"
_KEYS = ("xyz", "quaternion", "sigma_m", "sigma_deg")
# What is written with ten digits and read again is nearer, m and rad.
_NEAR = 1e-6


@dataclass(frozen=True)
class Mounting:
    """Where a member hangs: place t (3,), m, and rotation M (3, 3); sigma (6,), m and rad."""

    rig: str
    place: np.ndarray
    rotation: np.ndarray
    sigma: np.ndarray


@dataclass(frozen=True)
class Exposures:
    """Images of rigs: base (n,), member (n,): rows of images.csv.

    base is of the rig's base camera, or where it did not fire the first member that did.
    """

    base: np.ndarray
    member: np.ndarray


def rigs_of(block) -> dict[str, dict]:
    """The tables [rig.NAME]. Raises InputError where one is not as it should be."""
    rigs = block.extra.get("rig", {})
    owner: dict[str, str] = {}
    for name, rig in rigs.items() if isinstance(rigs, dict) else [("", {})]:
        where = f"block.toml: [rig.{name}]"
        rig = rig if isinstance(rig, dict) else {}
        members = rig.get("member")
        if not isinstance(members, dict) or not isinstance(rig.get("base"), str):
            raise InputError(
                f'{where} needs base = "CAMERA" and a table [rig.{name}.member.CAMERA] for each '
                "other camera"
            )
        for camera in (rig["base"], *members):
            if camera not in block.cameras:
                raise InputError(
                    f"{where} names camera {camera}, which block.toml does not have: it has "
                    f"{', '.join(block.cameras)}"
                )
            if camera in owner:
                raise InputError(f"{where} has camera {camera}, which rig {owner[camera]} has too: "
                                 "keep it in one of them")  # fmt: skip
            owner[camera] = name
        for camera, table in members.items():
            _check_member(f"block.toml: [rig.{name}.member.{camera}]", table)
    return rigs


def _check_member(where: str, table: object) -> None:
    if not isinstance(table, dict):
        raise InputError(f"{where} is not a table")
    for key in table:
        if key not in _KEYS:
            raise InputError(f"{where} has no {key}: use {', '.join(_KEYS)}")
    if ("xyz" in table) != ("quaternion" in table):
        raise InputError(f"{where} is given in part: give xyz and quaternion, or neither")
    for key, sizes in (("xyz", (3,)), ("quaternion", (4,)), ("sigma_m", (1, 3)),
                       ("sigma_deg", (1, 3))):  # fmt: skip
        if key not in table:
            continue
        numbers = np.atleast_1d(np.asarray(table[key], dtype=object))
        good = len(numbers) in sizes and all(map(is_number, numbers))
        if not good or (key.startswith("sigma") and min(numbers) < 0):
            size = " or ".join(map(str, sizes))
            raise InputError(f"{where}: {key} = {table[key]!r} is not {size} numbers"
                             + ", 0 or larger" * key.startswith("sigma"))  # fmt: skip
        if key == "quaternion" and abs(np.linalg.norm(table[key]) - 1) > 0.01:
            raise InputError(f"{where}: the length of quaternion is not 1: give a unit quaternion")


def members_of(block) -> dict[str, str]:
    """Camera -> its rig, of all members but the bases."""
    return {camera: name for name, rig in rigs_of(block).items() for camera in rig["member"]}


def exposures_of(block) -> Exposures:
    """Which images were taken together. Raises InputError where a camera fired twice at once."""
    nothing = np.zeros(0, dtype=np.int64)
    rigs, images = rigs_of(block), block.images
    if not rigs or EXPOSURE not in images:
        return Exposures(nothing, nothing)
    order = [camera for rig in rigs.values() for camera in (rig["base"], *rig["member"])]
    rig_of = np.repeat(np.arange(len(rigs)), [1 + len(rig["member"]) for rig in rigs.values()])
    exposure, names = pd.factorize(images[EXPOSURE], sort=True)
    place = pd.Index(order).get_indexer(images["camera"])
    rows = np.flatnonzero((exposure >= 0) & (place >= 0))
    rows = rows[np.lexsort((place[rows], exposure[rows], rig_of[place[rows]]))]
    keys = np.stack((rig_of[place[rows]], exposure[rows], place[rows]), axis=1)
    same = np.diff(keys, axis=0, prepend=-1) == 0
    if (twice := same.all(axis=1)).any():
        row = rows[twice].min()
        raise InputError(
            f"{block.where('images', row)}: exposure {names[exposure[row]]} has camera "
            f"{order[place[row]]} twice: give each exposure a name of its own"
        )
    first = ~same[:, :2].all(axis=1)
    base = rows[np.maximum.accumulate(np.where(first, np.arange(len(rows)), 0))]
    return Exposures(base[~first], rows[~first])


def mountings_of(block) -> dict[str, Mounting]:
    """Camera -> mounting, the bases among them. Raises InputError where nothing says it."""
    found = {}
    for name, rig in rigs_of(block).items():
        found[rig["base"]] = Mounting(name, np.zeros(3), np.eye(3), np.zeros(6))
        for camera, table in rig["member"].items():
            if "xyz" in table or not hasattr(block, "images"):
                place = np.array(table.get("xyz", [np.nan] * 3), float)
                turned = np.array(table.get("quaternion", [np.nan] * 4), float)
                rotation = rotation_from_quaternion(turned)
            else:
                place, rotation = _seen(block, name, rig["base"], camera)
            sigma = np.concatenate([
                np.broadcast_to(np.asarray(table.get(key, np.inf), float), 3) * unit
                for key, unit in (("sigma_m", 1.0), ("sigma_deg", np.radians(1.0)))
            ])  # fmt: skip
            found[camera] = Mounting(name, place, rotation, sigma)
    return found


def base_poses(block, mounted: dict[str, Mounting]) -> np.ndarray:
    """Where each image puts the base of its rig, (n, 7) as `Block.poses`; without one, itself."""
    poses = block.poses.copy()
    names = block.images["camera"].to_numpy(object)
    for camera, one in mounted.items():
        mine = np.flatnonzero(names == camera)
        rotation = one.rotation.T @ rotation_from_quaternion(poses[mine, 3:])
        poses[mine, :3] -= np.einsum("nji,j->ni", rotation, one.place)
        poses[mine, 3:] = quaternion_from_rotation(rotation)
    return poses


def as_mounted(block) -> bool:
    """Whether the images of each exposure stand as their rig says, to 1 um and 1e-6 rad."""
    base, both = base_poses(block, mountings_of(block)), exposures_of(block)
    turned = rotation_from_quaternion(base[:, 3:])
    off = [base[both.member, :3] - base[both.base, :3], turned[both.member] - turned[both.base]]
    return all(bool((np.abs(one) < _NEAR).all()) for one in off)


def seen_together(block, base: str, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) and rotations (n, 3, 3) of a member against the base, by the start poses of
    each exposure that has both."""
    both, names = exposures_of(block), block.images["camera"].to_numpy(object)
    mine = (names[both.base] == base) & (names[both.member] == camera)
    centre, turned = block.poses[:, :3], rotation_from_quaternion(block.poses[:, 3:])
    i, j = both.base[mine], both.member[mine]
    place = np.einsum("nij,nj->ni", turned[i], centre[j] - centre[i])
    against = turned[j] @ turned[i].transpose(0, 2, 1)
    known = np.isfinite(place).all(axis=1) & np.isfinite(against).all(axis=(1, 2))
    return place[known], against[known]


def _seen(block, rig: str, base: str, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Median place and mean rotation of a member against the base, by the start poses."""
    place, against = seen_together(block, base, camera)
    if not len(place):
        raise InputError(
            f"block.toml: [rig.{rig}.member.{camera}] has no xyz and quaternion, and no exposure "
            f"has start poses of both {base} and {camera}: give one of the two"
        )
    return np.median(place, axis=0), nearest_rotation(against.sum(axis=0))


def without_cameras(extra: dict, lost: set[str]) -> dict:
    """Keys of block.toml with rigs that have lost some cameras; none stays without its base."""
    if not isinstance(extra.get("rig"), dict):
        return extra
    rigs = {}
    for name, rig in extra["rig"].items():
        members = {camera: t for camera, t in rig["member"].items() if camera not in lost}
        if rig["base"] not in lost and members:
            rigs[name] = {**rig, "member": members}
    return {**extra, "rig": rigs} if rigs else {k: v for k, v in extra.items() if k != "rig"}


def relative(one: Mounting, other: Mounting) -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) and rotation (3, 3) of the other member in the frame of the one."""
    return one.rotation @ (other.place - one.place), other.rotation @ one.rotation.T


def with_rigid_poses(block):
    """The block with the poses of members that follow from their exposure's first known one.

    Those that are given otherwise are start values, and agree with the mounting from here on.
    """
    both = exposures_of(block)
    if not len(both.member):
        return block
    poses, first = block.poses.copy(), np.full(len(block.images), -1)
    base = np.unique(both.base)
    of, rows = np.concatenate([base, both.base]), np.concatenate([base, both.member])
    known = np.isfinite(poses[rows]).all(axis=1)
    some, at = np.unique(of[known], return_index=True)
    first[some] = rows[known][at]
    move = (first[of] >= 0) & (first[of] != rows)
    rows, first = rows[move], first[of][move]
    cameras, number = np.unique(block.images["camera"].to_numpy(object), return_inverse=True)
    mountings = mountings_of(block)
    for one, other in set(map(tuple, number[np.stack([first, rows], axis=1)].tolist())):
        place, against = relative(mountings[cameras[one]], mountings[cameras[other]])
        mine = (number[first] == one) & (number[rows] == other)
        turned = rotation_from_quaternion(poses[first[mine], 3:])
        poses[rows[mine], :3] = poses[first[mine], :3] + place @ turned
        poses[rows[mine], 3:] = quaternion_from_rotation(against @ turned)
    out = block.copy()
    out.put("images", POSE, poses)
    return out
