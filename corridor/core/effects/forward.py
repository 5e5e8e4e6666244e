"""What a block's measurements should be: the whole model, forward.

From this follow simulating an effect (add its difference to the measurements) and correcting it
(take the same difference out).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from corridor.core.block import Block
from corridor.core.camera import project_rays
from corridor.core.effects.context import Context, Images, control_names
from corridor.core.effects.stack import Arrays, Stack
from corridor.core.effects.values import Values
from corridor.core.geometry import rotation_from_vector


@dataclass
class Prediction:
    """Modelled observations, row for row of the block's tables.

    tie, mark: (n, 2) px, NaN where the point is not in front of the camera; gnss: (n, 3) antenna,
    m; attitude: (n, 3, 3) world to camera; control: (n, 3) coordinates as they would be given, m,
    for the rows of ground.csv with the role control; distance: (n,) as they would be given, m.
    """

    tie: np.ndarray
    mark: np.ndarray
    gnss: np.ndarray
    attitude: np.ndarray
    control: np.ndarray
    distance: np.ndarray


def predict(block: Block, values: Mapping = {}) -> Prediction:  # noqa: B006
    """What the block's own poses, cameras, points and the effects say should be measured.

    values: see `Values.of`. Poses, points (points.csv; marks: ground.csv, else points.csv) and
    cameras are those of the block; a lever arm is the stated one.
    """
    images = Images.of(block)
    return _predict(block, images, *gather(block, values, images))


def gather(block: Block, values: Mapping, images: Images | None = None) -> tuple[Stack, Arrays]:
    """The effects of a block with the values that are given, start values where none is.

    images: those of the block, where they are known already.
    """
    images = images or Images.of(block)
    given = Values.of(block, values, images)
    effects = [one.effect for one in given.values()]
    stack = Stack(block, effects, control_names(block), images)
    return stack, {slug: one.filled for slug, one in given.items()}


def _predict(
    block: Block, images: Images, stack: Stack, values: Arrays, measured: bool = False
) -> Prediction:
    """measured: whether effects see image points of the block as they were measured."""
    given = np.column_stack([block.ground[axis].to_numpy(float) for axis in "xyz"])
    control = given[(block.ground["role"] == "control").to_numpy()]
    return Prediction(
        tie=_seen(block, "tie_points", images, stack, values, measured),
        mark=_seen(block, "marks", images, stack, values, measured),
        gnss=_antenna(block, images, stack, values),
        attitude=_attitude(block, images, stack, values),
        control=control + stack.moved_ground(images, control_names(block), control, values),
        distance=_distance(block, images, stack, values),
    )


def _seen(block, table, images, stack, values, measured):
    rows = getattr(block, table)
    image = block.image_rows(table)
    position = block.positions(table)[rows["point"].array.codes]
    every = np.arange(len(images.names))
    shift, _ = stack.evaluate("camera", Context(images, every), values)
    interior = images.interior.copy()
    interior[:, : shift.shape[1]] += shift
    motion = np.zeros((len(rows), 6))
    moved = np.zeros((len(rows), 2))
    steady = not (stack.at("motion") or stack.at("image"))
    given = block.numbers(table, "x", "y") if measured else None
    pixel = None
    # An effect looks at the modelled image point, which it moves: a contraction, soon at rest.
    for _ in range(40):
        away = position - images.centre[image] - motion[:, :3]
        seen = np.einsum("nij,nj->ni", images.rotation[image], away)
        if motion[:, 3:].any():
            seen = np.einsum("nij,nj->ni", rotation_from_vector(-motion[:, 3:]), seen)
        depth = np.where(seen[:, 2] > 0, seen[:, 2], np.nan)
        ray = seen[:, :2] / depth[:, None]
        before, pixel = pixel, project_rays(ray, interior, image) + moved
        if steady or (
            before is not None and np.nanmax(np.abs(pixel - before), initial=0.0) < 1e-10
        ):
            break
        safe = np.nan_to_num(pixel)
        seen = Context(
            images, image, pixel=safe, ray=np.nan_to_num(ray), position=position, measured=given
        )
        motion, _ = stack.evaluate("motion", seen, values)
        moved, _ = stack.evaluate("image", seen, values)
    return pixel


def _antenna(block, images, stack, values):
    image = block.image_rows("gnss")
    shift, _ = stack.evaluate("antenna", Context(images, image), values)
    arm = stated_lever_arms(block)[images.flight[image]]
    to_world = images.rotation[image].transpose(0, 2, 1)
    return images.centre[image] + np.einsum("nij,nj->ni", to_world, arm) + shift


def _attitude(block, images, stack, values):
    image = block.image_rows("attitudes")
    shift, _ = stack.evaluate("attitude", Context(images, image), values)
    turned = images.rotation[image]
    return rotation_from_vector(-shift) @ turned if shift.any() else turned


def _distance(block, images, stack, values, sign=1.0):
    stated = moved = block.column("distances", "distance")
    # What an effect does is said of the measured distance: adding it is a contraction.
    for _ in range(40 if sign > 0 else 1):
        before, context = moved, Context(images, distance=np.arange(len(stated)), length=moved)
        moved = stated + sign * stack.evaluate("distance", context, values)[0][:, 0]
        if np.abs(moved - before).max(initial=0.0) < 1e-12:
            break
    return moved


def stated_lever_arms(block: Block) -> np.ndarray:
    """Lever arm (flights, 3) that block.toml states, zero where it states none; camera frame, m."""
    default = block.lever_arm.get("default", (0.0, 0.0, 0.0))
    return np.array([block.lever_arm.get(name, default) for name in block.flight_names], float)


def add(block: Block, values: Mapping) -> Block:
    """The block as it would have been measured with the effects on top.

    values: `{slug: {parameter: number}}`, see `Values.of`. The shifts are those at the poses,
    points and cameras of the block: adjust it first where they are rough.
    """
    return _moved(block, values, 1.0)


def take_out(block: Block, values: Mapping) -> Block:
    """The block with the effects taken out of its measurements: undoes `add`."""
    return _moved(block, values, -1.0)


def _moved(block: Block, values: Mapping, sign: float) -> Block:
    images = Images.of(block)
    stack, given = gather(block, values, images)
    neutral = {slug: np.zeros_like(v) for slug, v in given.items()}
    there, here = (_predict(block, images, stack, v, measured=sign < 0) for v in (given, neutral))
    out = block.copy()
    for table, kind, columns in (
        ("tie_points", "tie", ["x", "y"]),
        ("marks", "mark", ["x", "y"]),
        ("gnss", "gnss", ["x", "y", "z"]),
    ):
        difference = sign * (getattr(there, kind) - getattr(here, kind))
        rows = getattr(out, table)
        if len(rows) and np.nanmax(np.abs(difference), initial=0.0) > 0:
            rows[columns] = rows[columns].to_numpy(float) + np.nan_to_num(difference)
    turn = there.attitude @ here.attitude.transpose(0, 2, 1)
    if stack.at("attitude") and len(turn):
        turn = turn if sign > 0 else turn.transpose(0, 2, 1)
        out.put_attitudes(turn @ out.attitude_rotations)
    if stack.at("distance"):
        out.distances["distance"] = _distance(block, images, stack, given, sign)
    if stack.at("ground") and len(block.ground):
        names, stated = block.ground["point"].tolist(), block.numbers("ground", *"xyz")
        moved = stated
        # A point moves by what its true place says; from where it was given that is a contraction.
        for _ in range(40 if sign < 0 else 1):
            before = moved
            moved = stated + sign * stack.moved_ground(images, names, moved, given)
            if np.abs(moved - before).max() < 1e-12:
                break
        out.ground[["x", "y", "z"]] = moved
    return out
