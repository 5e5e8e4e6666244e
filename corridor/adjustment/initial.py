"""Start values: every pose and every point that a block leaves open.

Poses come from resection on ground marks and on tie points that are known already, the best
supported image first. Where too little is known, a chain starts from a pair of images in a frame
of its own and is brought to the ground points, poses and antenna positions it knows by a
similarity. Points are intersected from all rays that meet in them. None of this is more than a
start: the adjustment decides.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pandas as pd
from numba import njit
from scipy import sparse
from scipy.spatial import KDTree

from corridor.adjustment.similarity import Similarity, similarity
from corridor.block import Block
from corridor.camera import quaternion_from_rotation, rotation_from_quaternion, undistort
from corridor.errors import AdjustmentFailed, InputError

_CENTRE, _QUATERNION = ["x", "y", "z"], ["qw", "qx", "qy", "qz"]

# Reprojection that still counts as seen, px: for a known camera, then for stranger ones.
_GATES_PX = (4.0, 15.0, 60.0)
_AGREEING = 0.6
_FEWEST_MARKS, _FEWEST_POINTS = 4, 6
# Rays that meet at less than this fix no distance to chain from, or none at all.
_CHAIN_ANGLE, _NO_ANGLE = np.radians(0.5), np.radians(0.05)
# The chain is settled (adjusted on the way) whenever it has grown by this.
_GROWTH, _SWEEPS = 1.25, 4
# What a lens that is not calibrated may bend, as a start: k1 and k2 with this standard deviation.
_LENS = {"k1": 0.1, "k2": 0.1}
# A frame of its own goes over to the antenna positions when it has so many images and they
# spread to a side by this share of their length, or when it has grown too long.
_ISLAND, _ISLAND_WIDTH, _LONG_ISLAND = 6, 0.1, 40


def complete(block: Block, progress: Callable[[str], None] | None = None) -> Block:
    """The block with every pose and every point filled in; what is given is kept as it is.

    Ground points with coordinates (role control or check) orient images by their marks. Points
    without coordinates, tie points and measured ones that ground.csv lacks, get a row in `points`.
    progress: called with a line of text now and then.

    With no pose, no ground point and no antenna position the frame is free: the mean view looks
    down, the cameras' centre is the origin, and the median distance of a camera to its neighbour
    is 1.
    Raises InputError naming the images that cannot be oriented, and the remedy.
    """
    network = _Network(block)
    if network.posed.all() and (network.known | network.spare).all():
        return block
    if not network.posed.all():
        _orient(network, progress or (lambda line: None))
    network.intersect_all()
    return _filled(block, network)


def _filled(block: Block, network: _Network) -> Block:
    images, points = block.images, block.points
    rows = ~network.pose_given
    if rows.any():
        pose = np.column_stack([network.centre, quaternion_from_rotation(network.rotation)])
        images = images.copy()
        for name, value in zip(_CENTRE + _QUATERNION, pose.T, strict=True):
            images[name] = np.where(rows, value, block.column("images", name))
    new = ~network.point_given
    if new.any():
        place = pd.DataFrame(network.place[new], columns=_CENTRE)
        place.insert(0, "point", network.points[new])
        row = pd.Index(points["point"]).get_indexer(place["point"])
        there = row >= 0
        points = points.copy()
        for name in _CENTRE:
            values = points[name].to_numpy(copy=True)
            values[row[there]] = place[name].to_numpy()[there]
            points[name] = values
        points = pd.concat([points, place[~there]], ignore_index=True) if len(points) else place
    completed = block.copy()
    completed.images, completed.points = images, points
    completed.__post_init__()
    return completed


# --- orientation -----------------------------------------------------------------------------


def _orient(network: _Network, say: Callable[[str], None]) -> None:
    while True:
        network.intersect_new()
        network.chain(say)
        if network.posed.all():
            return
        _raise_island(network, say)


def _raise_island(network: _Network, say: Callable[[str], None]) -> None:
    """Orient images that the chain does not reach, in a frame of their own, and bring them over.

    Raises InputError where they hold together with nothing, or their frame cannot be found.
    """
    lost = ~network.posed
    rows = network.rows_of(lost)
    shared = np.zeros(len(network.points), dtype=bool)
    shared[network.point[rows]] = True
    # Oriented neighbours join, as what is known of them holds the island.
    members = lost.copy()
    members[network.image[shared[network.point]]] = True
    island = network.island(members)
    positions = np.isfinite(network.antenna).all(1)
    if not island.start_from_pair():
        raise _cannot(network, lost, "they share too few tie points with each other")

    def enough() -> bool:
        there = island.posed & positions
        if there.sum() < _ISLAND:
            return False
        return there.sum() >= _LONG_ISLAND or _width(network.antenna[there]) > _ISLAND_WIDTH

    island.chain(say, enough)
    island.settle()

    gained = island.posed & lost
    if not gained.any():
        raise _cannot(network, lost, "they share too few tie points with the others")
    frame = _frame(network, island)
    if frame is None:
        raise _cannot(
            network,
            gained,
            "they see too few ground points with coordinates and have no GNSS position",
        )
    network.centre[gained] = frame.apply(island.centre[gained])
    network.rotation[gained] = frame.apply_to_rotations(island.rotation[gained])
    network.posed |= gained
    network.gate = max(network.gate, island.gate)
    fresh = island.known & ~network.known
    network.place[fresh] = frame.apply(island.place[fresh])
    network.known |= fresh
    network.look_through(island.interior)
    network.carry(gained & positions)
    network.settle()


def _frame(network: _Network, island: _Network) -> Similarity | None:
    """Similarity from the island to the world, None where nothing fixes it."""
    points = np.flatnonzero(island.known & network.known)
    poses = np.flatnonzero(island.posed & network.posed)
    antenna = np.flatnonzero(island.posed & ~network.posed & np.isfinite(network.antenna).all(1))
    arm = np.einsum("nij,ni->nj", island.rotation[antenna], network.arm[antenna])

    def known_to_island(scale: float) -> np.ndarray:
        tips = island.centre[antenna] + arm / scale
        return np.concatenate([island.place[points], island.centre[poses], tips])

    source = known_to_island(np.inf)
    target = np.concatenate(
        [network.place[points], network.centre[poses], network.antenna[antenna]]
    )
    if len(source) >= 3 and _width(target) > 0.01:
        weights, frame = np.ones(len(source)), None
        for _ in range(8):
            try:
                frame = similarity(source, target, weights)
            except InputError:
                frame = None
                break
            source = known_to_island(frame.scale)
            off = np.linalg.norm(frame.apply(source) - target, axis=1)
            weights = 1 / (1 + (off / max(2 * np.median(off), 1e-12)) ** 2)
        if frame is not None:
            return frame
    # On one line, or less: the view tells how the island is turned about it.
    if len(poses):
        turns = np.swapaxes(network.rotation[poses], 1, 2) @ island.rotation[poses]
        rotation = _nearest_rotation(turns.sum(0))
    else:
        rotation = _look_down(island.rotation[island.posed])
    if len(source) == 0:
        if network.posed.any() or network.known.any():
            return None
        free = island.centre[island.posed]
        scale = 1 / _neighbour(free)
        return Similarity(scale, rotation, -scale * rotation @ free.mean(0))
    source_mean, target_mean = source.mean(0), target.mean(0)
    long = (source - source_mean) @ rotation.T
    reach = np.sqrt((long**2).sum())
    if len(source) == 1 or reach == 0:
        # One pose alone gives a place and a view, and no scale: that of the network is free.
        if not len(poses) or network.known.any() or len(antenna):
            return None
        scale = 1 / _neighbour(island.centre[island.posed])
    else:
        scale = np.sqrt(((target - target_mean) ** 2).sum()) / reach
        rotation = _turn_to(long, target - target_mean, rotation, about_view=not len(poses))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def _width(points: np.ndarray) -> float:
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return float(spread[1] / spread[0]) if spread[0] > 0 else 0.0


def _nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def _look_down(rotations: np.ndarray) -> np.ndarray:
    """Rotation of a frame that turns the mean view of its cameras to (0, 0, -1)."""
    view = rotations[:, 2].mean(0)
    right = rotations[:, 0].mean(0)
    length = np.linalg.norm(view)
    if length < 1e-6:
        return np.eye(3)
    down = -view / length
    right = right - (right @ down) * down
    if np.linalg.norm(right) < 1e-6:
        right = np.linalg.svd(down[None])[2][1]
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(down, right), down])


def _turn_to(
    source: np.ndarray, target: np.ndarray, rotation: np.ndarray, about_view: bool
) -> np.ndarray:
    """The rotation, turned on so that the line of the source lies along that of the target."""
    pair = source.T @ target
    u, _, vt = np.linalg.svd(pair)
    a, b = u[:, 0], vt[0]
    if a @ pair @ b < 0:
        b = -b
    if about_view:
        turn = np.arctan2(b[1], b[0]) - np.arctan2(a[1], a[0])
        c, s = np.cos(turn), np.sin(turn)
        level = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        rotation, a = level @ rotation, level @ a
    axis, cosine = np.cross(a, b), float(a @ b)
    if cosine < -0.999999:
        return rotation
    cross = np.cross(np.eye(3), axis)
    return (np.eye(3) - cross + cross @ cross / (1 + cosine)) @ rotation


def _neighbour(centres: np.ndarray) -> float:
    distance = KDTree(centres).query(centres, k=2)[0][:, 1]
    return float(np.median(distance)) or 1.0


def _cannot(network: _Network, lost: np.ndarray, why: str) -> InputError:
    names = network.images[lost]
    some = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    plural = len(names) > 1
    return InputError(
        f"images.csv: image{'s' if plural else ''} {some} cannot be oriented: {why}; give "
        f"{'their poses' if plural else 'its pose'}, measure at least {_FEWEST_MARKS} ground "
        f"points in {'one of them' if plural else 'it'}, or delete {'them' if plural else 'it'}"
    )


# --- the network -----------------------------------------------------------------------------


class _Network:
    """Rays between images and points, and what is known of both.

    image, point, ray (u, v): one observation a row, ordered by image, then by point name, so that
    the order of rows in the files does not count.
    posed, known: images and points that have a place so far; pose_given, point_given: those whose
    place is not ours to change. antenna: GNSS positions, NaN where none, arm: their stated lever
    arms. held: images whose centre GNSS gives; trusted: those whose antenna agrees with the rest.
    spare: measured ground points that are set aside.
    """

    def __init__(self, block: Block):
        self.block = block
        tables = [table for table in (block.tie_points, block.marks) if len(table)]
        self.images = block.images["image"].to_numpy(dtype=object)
        image = np.concatenate([block.image_rows(n) for n in ("tie_points", "marks")])
        names = [table["point"].cat.categories for table in tables]
        ranked = names[0].append(names[1:]).unique().sort_values()
        point = np.concatenate(
            [
                ranked.get_indexer(n)[table["point"].cat.codes.to_numpy()]
                for n, table in zip(names, tables, strict=True)
            ]
        )
        order = np.lexsort((point, image))
        seen = np.zeros(len(ranked), dtype=bool)
        seen[point] = True
        self.points = ranked.to_numpy(dtype=object)
        self.image = image[order].astype(np.int32)
        self.point = point[order].astype(np.int32)
        pixels = np.concatenate([t[["x", "y"]].to_numpy(dtype=float) for t in tables])
        self.measured = pixels[order]
        self.camera = pd.Index(list(block.cameras)).get_indexer(block.images["camera"])
        self.look_through(np.array([camera.interior for camera in block.cameras.values()]))

        pose = np.column_stack([block.column("images", name) for name in _CENTRE + _QUATERNION])
        self.posed = np.isfinite(pose).all(1)
        self.pose_given = self.posed.copy()
        self.centre = pose[:, :3].copy()
        self.rotation = np.full((len(pose), 3, 3), np.nan)
        self.rotation[self.posed] = rotation_from_quaternion(pose[self.posed, 3:])
        self.antenna = np.full((len(pose), 3), np.nan)
        if len(block.gnss):
            self.antenna[block.image_rows("gnss")] = block.gnss[_CENTRE].to_numpy(dtype=float)
        arms = [
            block.lever_arm.get(flight, block.lever_arm.get("default", (0.0, 0.0, 0.0)))
            for flight in block.flight_names
        ]
        self.arm = np.array(arms, dtype=float)[block.image_flight]

        self.place = np.full((len(ranked), 3), np.nan)
        self.ground = np.zeros(len(ranked), dtype=bool)
        spare = np.zeros(len(ranked), dtype=bool)
        for frame in (block.points, block.ground):
            row = ranked.get_indexer(frame["point"])
            self.place[row[row >= 0]] = frame[_CENTRE].to_numpy(dtype=float)[row >= 0]
        row = ranked.get_indexer(block.ground["point"])
        unused = (block.ground["role"] == "unused").to_numpy()
        self.ground[row[(row >= 0) & ~unused]] = True
        # A ground point set aside orients nothing, though its coordinates are there.
        spare[row[(row >= 0) & unused]] = True
        self.point_given = np.isfinite(self.place).all(1) | ~seen
        self.known = self.point_given & ~spare
        self.spare = spare
        self._index()

    def look_through(self, interior: np.ndarray) -> None:
        """Rays of all measurements through cameras with these interior vectors (m, 15)."""
        self.interior = interior
        self.pixel = 1.0 / interior[self.camera, 0]
        row = self.camera[self.image]
        self.ray = undistort(self.measured, interior, row)
        lost = np.isnan(self.ray[:, 0])  # beyond the fold of the stated distortion
        plain = interior[row[lost]]
        self.ray[lost] = (self.measured[lost] - plain[:, 1:3]) / plain[:, :1]

    def _index(self) -> None:
        self.by_point = np.argsort(self.point, kind="stable")
        self.point_start = _starts(self.point, len(self.points))
        self.image_start = _starts(self.image, len(self.images))
        self.gate = _GATES_PX[0]
        self.held = np.zeros(len(self.images), dtype=bool)
        self.trusted = self.held.copy()

    def island(self, members: np.ndarray) -> _Network:
        """The same network seen from some images only, with nothing known of it yet."""
        island = object.__new__(_Network)
        island.block, island.camera = self.block, self.camera
        island.images, island.points = self.images, self.points
        rows = members[self.image]
        island.image, island.point = self.image[rows], self.point[rows]
        island.measured = self.measured[rows]
        island.look_through(self.interior)
        island.posed = np.zeros_like(self.posed)
        island.pose_given = island.posed.copy()
        island.known = np.zeros_like(self.known)
        island.point_given, island.ground = island.known.copy(), island.known.copy()
        island.spare = island.known.copy()
        island.centre = np.full_like(self.centre, np.nan)
        island.rotation = np.full_like(self.rotation, np.nan)
        island.place = np.full_like(self.place, np.nan)
        island.antenna, island.arm = np.full_like(self.antenna, np.nan), self.arm
        island._index()
        return island

    def rows_of(self, images: np.ndarray) -> np.ndarray:
        return np.flatnonzero(images[self.image])

    def carry(self, images: np.ndarray) -> None:
        """Put the centres of images where GNSS has them, and fit all else to that.

        A frame of its own is bent where the camera is not known well; GNSS straightens it. Images
        that then do not see their points any more keep their own centre: their fix is wrong.
        """
        rows = np.flatnonzero(images)
        if not len(rows):
            return
        free = self.rotation.copy(), self.centre.copy()
        self.held[rows] = self.trusted[rows] = True
        for wide in (_GATES_PX[-1], _GATES_PX[-1], self.gate):
            gate, self.gate = self.gate, wide
            for _ in range(_SWEEPS):
                self.refine(rows)
                self.intersect_new(again=True)
            self.gate = gate
        wrong = [i for i in rows if self.agreement(i, _GATES_PX[-1]) < _AGREEING]
        self.held[wrong] = self.trusted[wrong] = False
        for mine, before in zip((self.rotation, self.centre), free, strict=True):
            mine[wrong] = before[wrong]
        if wrong:
            self.refine(np.array(wrong))
            self.intersect_new(again=True)

    def agreement(self, image: int, gate: float) -> float:
        """Share of the known points of an image that are seen within the gate (px)."""
        rows = slice(self.image_start[image], self.image_start[image + 1])
        known = self.known[self.point[rows]]
        seen = self.place[self.point[rows][known]] - self.centre[image]
        seen = seen @ self.rotation[image].T
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - self.ray[rows][known], axis=1)
        fine = (seen[:, 2] > 0) & (off < gate * self.pixel[image])
        return float(fine.mean()) if len(fine) else 0.0

    # --- points

    def _intersect(self, points: np.ndarray, depth: np.ndarray | None = None):
        return _intersect(
            points.astype(np.int64), self.point_start, self.by_point, self.image, self.ray,
            self.rotation, self.centre, self.posed, self.pixel, self.gate,
            np.zeros(0) if depth is None else depth,
        )  # fmt: skip

    def intersect_new(self, again: bool = False, within: np.ndarray | None = None) -> None:
        """Place points that two oriented images or more see well enough to chain from.

        again: those placed before as well. within: only these points.
        """
        wanted = ~self.point_given & ~self.spare
        if not again:
            wanted &= ~self.known
        points = np.flatnonzero(wanted) if within is None else within[wanted[within]]
        place, angle, good, rays, ahead = self._intersect(points)
        fine = ahead & (angle > _CHAIN_ANGLE) & (good >= 2) & (good >= _AGREEING * rays)
        self.place[points[fine]] = place[fine]
        self.known[points] = fine

    def intersect_all(self) -> None:
        """Place every point that is not given, those too that the rays hardly fix."""
        points = np.flatnonzero(~self.point_given)
        place, angle, _, rays, ahead = self._intersect(points)
        fine = ahead & (angle > _NO_ANGLE) & (rays >= 2)
        self.place[points[fine]] = place[fine]
        self.known[points[fine]] = True
        if fine.all():
            return
        # What the rays do not tell, the points around tell: their depth in each image.
        depth = _depths(
            self.image, self.point, self.place, self.known, self.rotation, self.centre, self.posed
        )
        overall = np.nanmedian(depth) if np.isfinite(depth).any() else 1.0
        depth = np.where(np.isfinite(depth), depth, overall)
        rest = points[~fine]
        place, *_ = self._intersect(rest, depth)
        self.place[rest] = place
        self.known[rest] = np.isfinite(place).all(1)

    # --- poses

    def chain(self, say: Callable[[str], None], enough: Callable[[], bool] | None = None) -> None:
        """Resect images from known points, the best supported first, until none or enough."""
        seen_known = np.bincount(
            self.image, weights=self.known[self.point], minlength=len(self.images)
        )
        tried = np.full(len(self.images), -1.0)
        settled = self.posed.sum()
        while enough is None or not enough():
            support = np.where(self.posed | (seen_known <= 1.2 * tried), -1, seen_known)
            image = int(np.argmax(support))
            if support[image] < _FEWEST_MARKS:
                return
            tried[image] = support[image]
            if not self.resect(image):
                continue
            points = self.point[self.image_start[image] : self.image_start[image + 1]]
            before = self.known[points].copy()
            self.intersect_new(again=True, within=points)
            fresh = points[self.known[points] & ~before]
            _count(fresh, self.point_start, self.by_point, self.image, seen_known)
            total = int(self.posed.sum())
            if total % 100 == 0:
                say(f"start values: {total} of {len(self.images)} images oriented")
            if total > _GROWTH * settled:
                self.settle()
                settled = total

    def settle(self) -> None:
        """Straighten what is oriented so far: by an adjustment, or where that cannot be, own poses
        from the points and own points from the poses, a few times."""
        if self._adjust():
            self.intersect_new(again=True)
            return
        own = np.flatnonzero(self.posed & ~self.pose_given)
        for _ in range(_SWEEPS):
            self.refine(own)
            self.intersect_new(again=True)

    def _adjust(self) -> bool:
        """Adjust the oriented part, with k1 and k2 of lenses that are not calibrated.

        Without those a chain bends: an unknown k1 of 0.04 tilts each image by a degree against
        its neighbour. False where given poses or points must stay, or the part has no datum yet.
        """
        # The adjustment completes blocks itself: the two know each other only when called.
        from corridor.adjustment.adjust import adjust

        posed = np.flatnonzero(self.posed)
        if self.pose_given.any() or (self.point_given & self.known & ~self.ground).any():
            return False
        cameras = {
            name: camera.with_interior(interior)
            for (name, camera), interior in zip(
                self.block.cameras.items(), self.interior, strict=True
            )
        }
        lens = {
            name: "fixed" if camera.calibrated else ",".join(_LENS)
            for name, camera in cameras.items()
        }
        priors = {
            f"camera.{name}.{term}": (camera[term], sigma)
            for name, camera in cameras.items()
            for term, sigma in _LENS.items()
            if lens[name] != "fixed" and np.isin(self.camera[posed], [*cameras].index(name)).any()
        }
        try:
            result = adjust(
                self._part(cameras, posed), camera=lens, loss="huber:3", priors=priors,
                max_iterations=10,
            )  # fmt: skip
        except (InputError, AdjustmentFailed):
            return False
        block = result.block
        pose = block.images[_CENTRE + _QUATERNION].to_numpy()
        self.centre[posed], self.rotation[posed] = (
            pose[:, :3],
            rotation_from_quaternion(pose[:, 3:]),
        )
        row = pd.Index(self.points).get_indexer(block.points["point"])
        mine = ~self.point_given[row]
        self.place[row[mine]] = block.points[_CENTRE].to_numpy()[mine]
        self.held[:] = False
        interior = self.interior.copy()
        for name, camera in block.cameras.items():
            interior[[*cameras].index(name)] = camera.interior
        self.look_through(interior)
        return True

    def _part(self, cameras: dict, posed: np.ndarray) -> Block:
        """The oriented images with the points that are known, as a block."""
        rows = np.flatnonzero(self.posed[self.image] & self.known[self.point])
        marked = self.ground[self.point[rows]]
        whole = self.block

        def seen(rows: np.ndarray) -> pd.DataFrame:
            return pd.DataFrame(
                {
                    "point": self.points[self.point[rows]],
                    "image": self.images[self.image[rows]],
                    "x": self.measured[rows, 0],
                    "y": self.measured[rows, 1],
                }
            )

        images = whole.images.iloc[posed][
            [name for name in ("image", "camera", "flight") if name in whole.images]
        ].reset_index(drop=True)
        pose = np.column_stack([self.centre[posed], quaternion_from_rotation(self.rotation[posed])])
        images[_CENTRE + _QUATERNION] = pose
        tied = np.unique(self.point[rows[~marked]])
        held = np.flatnonzero(self.trusted & self.posed)
        used = set(images["camera"])
        flights = set(images["flight"]) if "flight" in images else set()
        return Block(
            name=whole.name,
            cameras={name: camera for name, camera in cameras.items() if name in used},
            images=images,
            tie_points=seen(rows[~marked]),
            points=pd.DataFrame({"point": self.points[tied]}).assign(
                **dict(zip(_CENTRE, self.place[tied].T, strict=True))
            ),
            marks=seen(rows[marked]),
            ground=whole.ground[whole.ground["point"].isin(self.points[self.point[rows[marked]]])],
            gnss=whole.gnss[whole.gnss["image"].isin(self.images[held])],
            sigma=whole.sigma,
            lever_arm={
                flight: arm
                for flight, arm in whole.lever_arm.items()
                if flight == "default" or flight in flights
            },
            lever_arm_fixed=whole.lever_arm_fixed,
        )

    def refine(self, images: np.ndarray) -> None:
        """Poses of oriented images from the known points they see; a GNSS position stays."""
        for _ in range(3 if self.held[images].any() else 1):
            at = images[self.held[images]]
            self.centre[at] = self.antenna[at] - np.einsum(
                "nij,ni->nj", self.rotation[at], self.arm[at]
            )
            _refine_poses(
                images.astype(np.int64), self.image_start, self.point, self.ray, self.place,
                self.known, self.rotation, self.centre, self.pixel, self.gate, self.held,
            )  # fmt: skip

    def resect(self, image: int) -> bool:
        """Pose of one image from the known points it sees; False where they do not agree on one.

        Source of the closed solutions: OpenCV (AP3P within RANSAC; SQPNP for a few points).
        """
        rows = np.arange(self.image_start[image], self.image_start[image + 1])
        rows = rows[self.known[self.point[rows]]]
        place, ray = self.place[self.point[rows]], np.ascontiguousarray(self.ray[rows])
        marks = int(self.ground[self.point[rows]].sum())
        if len(rows) < _FEWEST_POINTS and marks < _FEWEST_MARKS:
            return False
        origin = place.mean(0)
        reach = np.abs(place - origin).max()
        if reach == 0 or _line_like(place):
            return False
        near = np.ascontiguousarray((place - origin) / reach)
        for gate in [g for g in _GATES_PX if g >= self.gate]:
            found = _pnp(near, ray, gate * self.pixel[image])
            if found is None:
                continue
            rotation, centre, agreeing = found
            if agreeing < _AGREEING and gate < _GATES_PX[-1]:
                continue
            if agreeing * len(rows) < min(_FEWEST_POINTS, len(rows)) or agreeing < 0.3:
                continue
            self.rotation[image], self.centre[image] = rotation, centre * reach + origin
            self.posed[image] = True
            self.gate = max(self.gate, gate)
            here = np.array([image])
            self.refine(here)
            # Many marks know better than a GNSS that may be in another datum.
            if marks < _FEWEST_MARKS and np.isfinite(self.antenna[image]).all():
                self._hold(image)
            return True
        return False

    def _hold(self, image: int) -> None:
        """Take the centre of an image from GNSS, if it still sees its points from there."""
        here = np.array([image])
        free = self.rotation[image].copy(), self.centre[image].copy()
        before = self.agreement(image, _GATES_PX[-1])
        self.held[image] = self.trusted[image] = True
        self.refine(here)
        if self.agreement(image, _GATES_PX[-1]) < _AGREEING * before:
            self.held[image] = self.trusted[image] = False
            self.rotation[image], self.centre[image] = free

    def start_from_pair(self) -> bool:
        """Orient the best pair of images relative to each other; False where there is none.

        The first camera is the frame, the base is 1.
        """
        best = None
        for gate in _GATES_PX:
            for first, second in self._pairs():
                found = self._pair(first, second, gate)
                if found is not None and (best is None or found[0] > best[0]):
                    best = (*found, first, second)
            if best is not None and best[1] >= _AGREEING:
                break
        if best is None:
            return False
        _, _, rotation, centre, first, second = best
        self.rotation[first], self.centre[first] = np.eye(3), 0.0
        self.rotation[second], self.centre[second] = rotation, centre
        self.posed[[first, second]] = True
        self.gate = gate
        self.intersect_new()
        return bool(self.known.any())

    def _pairs(self, most: int = 60) -> list[tuple[int, int]]:
        """Pairs that share many points, neighbours and wider ones."""
        seen = sparse.csr_matrix(
            (np.ones(len(self.image)), (self.image, self.point)),
            shape=(len(self.images), len(self.points)),
        )
        shared = sparse.triu(seen @ seen.T, k=1).tocoo()
        many = shared.data >= 8
        row, column, count = shared.row[many], shared.col[many], shared.data[many]
        order = np.lexsort((column, row, -count))
        wide = order[count[order] >= 0.3 * count.max()] if len(order) else order
        chosen = np.union1d(order[: most // 2], wide[:: max(1, 2 * len(wide) // most)])
        return [(int(row[k]), int(column[k])) for k in chosen]

    def _pair(self, first: int, second: int, gate: float):
        """Score, agreeing share, rotation and centre of the second image, or None."""
        rows = [slice(self.image_start[i], self.image_start[i + 1]) for i in (first, second)]
        _, a, b = np.intersect1d(
            self.point[rows[0]], self.point[rows[1]], assume_unique=True, return_indices=True
        )
        a, b = self.ray[rows[0]][a], self.ray[rows[1]][b]
        best = None
        for rotation, centre in _relative(a, b, gate * max(self.pixel[first], self.pixel[second])):
            pair = np.stack([np.eye(3), rotation]), np.stack([np.zeros(3), centre])
            count = len(a)
            place, angle, good, _, ahead = _intersect(
                np.arange(count), np.arange(0, 2 * count + 1, 2), np.arange(2 * count),
                np.tile(np.array([0, 1], dtype=np.int32), count),
                np.stack([a, b], 1).reshape(-1, 2), *pair, np.ones(2, dtype=bool),
                self.pixel[[first, second]], gate, np.zeros(0),
            )  # fmt: skip
            fine = ahead & (good == 2)
            if fine.sum() < 8:
                continue
            spread = min(np.median(angle[fine]), np.radians(20.0))
            if spread < _CHAIN_ANGLE:
                continue
            score = fine.sum() * spread
            if best is None or score > best[0]:
                best = (score, fine.mean(), rotation, centre)
        return best


def _line_like(points: np.ndarray) -> bool:
    return _width(points) < 1e-3


def _starts(codes: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.bincount(codes, minlength=count))])


def _pnp(points: np.ndarray, rays: np.ndarray, gate: float):
    """Rotation, centre and agreeing share of a resection on points near the origin, or None."""
    cv2.setRNGSeed(0)
    try:
        if len(points) < _FEWEST_POINTS:
            done, turn, shift = cv2.solvePnP(
                points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
            )
        else:
            done, turn, shift, _ = cv2.solvePnPRansac(
                points, rays, np.eye(3), None, iterationsCount=300, reprojectionError=gate,
                confidence=0.9999, flags=cv2.SOLVEPNP_AP3P,
            )  # fmt: skip
    except cv2.error:
        return None
    if not done:
        return None
    rotation = cv2.Rodrigues(turn)[0]
    seen = points @ rotation.T + shift.ravel()
    ahead = seen[:, 2] > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.linalg.norm(seen[:, :2] / seen[:, 2:] - rays, axis=1)
    agreeing = ahead if len(points) < _FEWEST_POINTS else ahead & (off < gate)
    return rotation, -rotation.T @ shift.ravel(), agreeing.mean()


def _relative(a: np.ndarray, b: np.ndarray, gate: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotations and centres (base 1) of a second camera that sees rays b where the first sees a.

    Both the essential matrix and the homography are asked: on flat ground the first has a second
    solution, in relief the other has none.
    """
    cv2.setRNGSeed(0)
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    found = []
    try:
        essential, mask = cv2.findEssentialMat(
            a, b, np.eye(3), method=cv2.RANSAC, prob=0.9999, threshold=gate
        )
        if essential is not None and essential.shape == (3, 3):
            _, rotation, shift, _ = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask)
            found.append((rotation, -rotation.T @ shift.ravel()))
        plane, _ = cv2.findHomography(a, b, cv2.RANSAC, 3 * gate)
        if plane is not None:
            _, rotations, shifts, _ = cv2.decomposeHomographyMat(plane, np.eye(3))
            for rotation, shift in zip(rotations, shifts, strict=True):
                length = np.linalg.norm(shift)
                if length > 1e-6:
                    found.append((rotation, -rotation.T @ shift.ravel() / length))
    except cv2.error:
        pass
    return found


# --- kernels ---------------------------------------------------------------------------------


@njit(cache=True)
def _count(points, point_start, by_point, image, counts):
    for p in points:
        for n in range(point_start[p], point_start[p + 1]):
            counts[image[by_point[n]]] += 1


@njit(cache=True)
def _depths(image, point, place, known, rotation, centre, posed):
    """Median depth of the known points in each image, NaN where there is none."""
    out = np.full(len(posed), np.nan)
    depth = np.empty(len(image))
    n = 0
    while n < len(image):
        i = image[n]
        count = 0
        while n < len(image) and image[n] == i:
            p = point[n]
            if posed[i] and known[p]:
                z = 0.0
                for k in range(3):
                    z += rotation[i, 2, k] * (place[p, k] - centre[i, k])
                if z > 0.0:
                    depth[count] = z
                    count += 1
            n += 1
        if count:
            out[i] = np.median(depth[:count])
    return out


@njit(cache=True)
def _solve3(m, b):
    """Solution of a symmetric 3 x 3 system and whether there is one."""
    c00 = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    c01 = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    c02 = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    det = m[0, 0] * c00 + m[0, 1] * c01 + m[0, 2] * c02
    x = np.zeros(3)
    if abs(det) < 1e-300:
        return x, False
    x[0] = (b[0] * c00 + b[1] * c01 + b[2] * c02) / det
    x[1] = (
        b[0] * (m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2])
        + b[1] * (m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0])
        + b[2] * (m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1])
    ) / det
    x[2] = (
        b[0] * (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1])
        + b[1] * (m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2])
        + b[2] * (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
    ) / det
    return x, True


@njit(cache=True)
def _intersect(points, point_start, by_point, image, ray, rotation, centre, posed, pixel, gate,
               depth):  # fmt: skip
    """Places (n, 3) of points where their rays meet; largest angle between two rays (rad), rays
    within the gate, rays, and whether the place lies in front of all cameras.

    First the point nearest to all rays, then Gauss-Newton on the image coordinates with Cauchy
    weights. depth: one for each image, or empty; when given, rays that do not fix the distance
    are stopped there.
    """
    places = np.full((len(points), 3), np.nan)
    angles = np.zeros(len(points))
    goods = np.zeros(len(points), dtype=np.int64)
    counts = np.zeros(len(points), dtype=np.int64)
    aheads = np.zeros(len(points), dtype=np.bool_)
    m = np.empty((3, 3))
    b = np.empty(3)
    for q in range(len(points)):
        first, last = point_start[points[q]], point_start[points[q] + 1]
        count = 0
        base = np.zeros(3)
        for n in range(first, last):
            i = image[by_point[n]]
            if posed[i]:
                count += 1
                base += centre[i]
        counts[q] = count
        if count == 0:
            continue
        base /= count
        way = np.empty((count, 3))
        eye = np.empty((count, 3))
        row = np.empty(count, dtype=np.int64)
        stop = np.zeros(3)
        m[:] = 0.0
        b[:] = 0.0
        k = 0
        for n in range(first, last):
            o = by_point[n]
            i = image[o]
            if not posed[i]:
                continue
            u, v = ray[o, 0], ray[o, 1]
            length = np.sqrt(u * u + v * v + 1.0)
            for c in range(3):
                d = rotation[i, 0, c] * u + rotation[i, 1, c] * v + rotation[i, 2, c]
                way[k, c] = d / length
                eye[k, c] = centre[i, c] - base[c]
                if len(depth):
                    stop[c] += (eye[k, c] + depth[i] * d) / count
            row[k] = o
            along = way[k, 0] * eye[k, 0] + way[k, 1] * eye[k, 1] + way[k, 2] * eye[k, 2]
            for c in range(3):
                for e in range(3):
                    m[c, e] -= way[k, c] * way[k, e]
                m[c, c] += 1.0
                b[c] += eye[k, c] - along * way[k, c]
            k += 1
        smallest = 1.0
        for k in range(1, count):
            for h in range(k if count <= 12 else 1):
                cosine = way[k, 0] * way[h, 0] + way[k, 1] * way[h, 1] + way[k, 2] * way[h, 2]
                smallest = min(smallest, cosine)
        angles[q] = np.arccos(max(-1.0, smallest))
        if len(depth):
            # A pull to the stop, a thousandth of a ray that would see it from the side.
            for c in range(3):
                m[c, c] += 1e-3 * count
                b[c] += 1e-3 * count * stop[c]
        x, solved = _solve3(m, b)
        if not solved:
            x[:] = stop
        place, good, ahead = _polish(x, eye, row, ray, image, rotation, pixel, gate,
                                     len(depth) == 0 and count > 1)  # fmt: skip
        if len(depth) and not ahead:
            place[:] = stop
        places[q] = place + base
        goods[q] = good
        aheads[q] = ahead
    return places, angles, goods, counts, aheads


@njit(cache=True)
def _polish(start, eye, row, ray, image, rotation, pixel, gate, move):
    x = start.copy()
    m = np.empty((3, 3))
    b = np.empty(3)
    best = x.copy()
    best_cost = np.inf
    best_good = 0
    best_ahead = False
    for step in range(8 if move else 1):
        m[:] = 0.0
        b[:] = 0.0
        cost = 0.0
        good = 0
        ahead = True
        for k in range(len(row)):
            o = row[k]
            i = image[o]
            r = rotation[i]
            d0, d1, d2 = x[0] - eye[k, 0], x[1] - eye[k, 1], x[2] - eye[k, 2]
            z = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
            if z <= 0.0:
                ahead = False
                continue
            u = (r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2) / z
            v = (r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2) / z
            eu = (ray[o, 0] - u) / pixel[i]
            ev = (ray[o, 1] - v) / pixel[i]
            square = (eu * eu + ev * ev) / (gate * gate)
            cost += np.log1p(square)
            if square <= 1.0:
                good += 1
            w = 1.0 / (1.0 + square)
            for c in range(3):
                ju = (r[0, c] - u * r[2, c]) / z / pixel[i]
                jv = (r[1, c] - v * r[2, c]) / z / pixel[i]
                b[c] += w * (ju * eu + jv * ev)
                for e in range(3):
                    m[c, e] += w * (
                        ju * (r[0, e] - u * r[2, e]) + jv * (r[1, e] - v * r[2, e])
                    ) / z / pixel[i]  # fmt: skip
        if step and not (ahead and (cost < best_cost or not best_ahead)):
            break
        gain = best_cost - cost
        best[:] = x
        best_cost, best_good, best_ahead = cost, good, ahead
        if not ahead or gain < 1e-9 * (1.0 + cost):
            break
        for c in range(3):
            m[c, c] *= 1.0 + 1e-9
        dx, solved = _solve3(m, b)
        if not solved:
            break
        x += dx
    return best, best_good, best_ahead


@njit(cache=True)
def _refine_poses(images, image_start, point, ray, place, known, rotation, centre, pixel, gate,
                  at):  # fmt: skip
    """Poses that fit the known points best: Levenberg-Marquardt, Cauchy weights, in place.

    at: images whose centre stays.
    """
    for i in images:
        free = 3 if at[i] else 6
        r, c = rotation[i].copy(), centre[i].copy()
        rows = np.empty(image_start[i + 1] - image_start[i], dtype=np.int64)
        count = 0
        for n in range(image_start[i], image_start[i + 1]):
            if known[point[n]]:
                rows[count] = n
                count += 1
        if count < 4:
            continue
        rows = rows[:count]
        damping = 1e-6
        cost, m, b = _pose_system(r, c, rows, point, ray, place, pixel[i], gate, free)
        for _ in range(20):
            system = m.copy()
            for k in range(free):
                system[k, k] += damping * (m[k, k] + 1e-12)
            step = np.linalg.solve(system, b)
            w = step[:3]
            angle = np.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
            turn = _turn(w, angle)
            trial_r = turn @ r
            trial_c = c.copy()
            if free == 6:
                trial_c += step[3:]
            trial, m2, b2 = _pose_system(
                trial_r, trial_c, rows, point, ray, place, pixel[i], gate, free
            )
            if trial <= cost:
                gain = cost - trial
                r, c, cost, m, b = trial_r, trial_c, trial, m2, b2
                damping = max(damping * 0.1, 1e-12)
                if gain <= 1e-9 * (1.0 + cost):
                    break
            else:
                damping *= 30.0
                if damping > 1e6:
                    break
        rotation[i] = r
        centre[i] = c


@njit(cache=True)
def _turn(w, angle):
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-8:
        return np.eye(3) + cross
    s = np.sin(angle) / angle
    h = np.sin(angle / 2) / (angle / 2)
    return np.eye(3) + s * cross + 0.5 * h * h * (cross @ cross)


@njit(cache=True)
def _pose_system(r, c, rows, point, ray, place, pixel, gate, free):
    m = np.zeros((free, free))
    b = np.zeros(free)
    cost = 0.0
    ju = np.empty(6)
    jv = np.empty(6)
    for n in rows:
        p = point[n]
        d0, d1, d2 = place[p, 0] - c[0], place[p, 1] - c[1], place[p, 2] - c[2]
        x = r[0, 0] * d0 + r[0, 1] * d1 + r[0, 2] * d2
        y = r[1, 0] * d0 + r[1, 1] * d1 + r[1, 2] * d2
        z = r[2, 0] * d0 + r[2, 1] * d1 + r[2, 2] * d2
        if z <= 0.0:
            cost += 50.0
            continue
        u, v = x / z, y / z
        eu, ev = (ray[n, 0] - u) / pixel, (ray[n, 1] - v) / pixel
        square = (eu * eu + ev * ev) / (gate * gate)
        cost += np.log1p(square)
        w = 1.0 / (1.0 + square)
        # d(x, y, z) by a small turn of the camera is the turn times (x, y, z), by its centre -R.
        ju[0], jv[0] = -u * v, -(1.0 + v * v)
        ju[1], jv[1] = 1.0 + u * u, u * v
        ju[2], jv[2] = -v, u
        for k in range(3):
            ju[3 + k] = -(r[0, k] - u * r[2, k]) / z
            jv[3 + k] = -(r[1, k] - v * r[2, k]) / z
        for k in range(free):
            b[k] += w * (ju[k] * eu + jv[k] * ev) / pixel
            for h in range(free):
                m[k, h] += w * (ju[k] * ju[h] + jv[k] * jv[h]) / (pixel * pixel)
    return cost, m, b
