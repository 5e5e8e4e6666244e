"""One simulated counterpart as a block that any program can adjust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from corridor.core.block import Block
from corridor.core.effects import Values, add, effect_of
from corridor.core.engine.threads import one_thread
from corridor.core.errors import InputError
from corridor.core.geometry import quaternion_from_rotation
from corridor.core.simulation import Simulated
from corridor.diagnosis.bootstrap.replicator import Replicator

if TYPE_CHECKING:
    from corridor.core.adjustment import Adjustment


def counterpart(
    adjustment: Adjustment, seed: int = 0, effects: Mapping[str, Mapping] | None = None
) -> Simulated:
    """One simulated counterpart as a block: the measured one's, had the model been the truth.

    Start values are those of the measured block. Marks of ground points with the role `unused`
    are left out, and so is a track: the model says nothing on them. `truth` holds the adjusted
    model and the noise that was drawn.

    effects: `{slug: {parameter: value}}` on top, which the believed model does not have.
    """
    effects = effects or {}
    with one_thread():
        replicator = Replicator(adjustment)
    system, drawn = replicator.system, replicator.draw(np.random.default_rng([seed, 0]))
    block = system.block.copy()
    xy = np.full((len(block.tie_points) + len(block.marks), 2), np.nan)
    xy[system.image_rows.row] = drawn.xy
    ties = len(block.tie_points)
    for table, values in (("tie_points", xy[:ties]), ("marks", xy[ties:])):
        frame = getattr(block, table).assign(x=values[:, 0], y=values[:, 1])
        frame = frame[np.isfinite(values[:, 0])].reset_index(drop=True)
        frame["point"] = frame["point"].cat.remove_unused_categories()
        setattr(block, table, frame)
    if len(drawn.gnss):
        known = np.flatnonzero(np.isfinite(block.gnss[["x", "y", "z"]].to_numpy(float)).all(axis=1))
        block.gnss.loc[block.gnss.index[known], ["x", "y", "z"]] = system.gnss.along_axes(
            drawn.gnss
        )
    if len(block.attitudes):
        turned = block.attitude_rotations
        count = len(system.attitude.given)
        given = system.measuring(attitude=drawn.posed[:count]).problem.attitude_given
        turned[np.isfinite(turned).all(axis=(1, 2))] = given
        block.put_attitudes(turned)
    if len(drawn.distance):
        row = block.distances.index[system.problem.distance_rows]
        block.distances.loc[row, "distance"] = drawn.distance[:, 0]
    given = system.control.along_axes(drawn.control)[: len(system.control_rows)]
    for rows, values in (
        (system.control_rows, given),
        (replicator.check_rows, drawn.check + replicator.check_moved),
    ):
        if len(rows):
            block.ground.loc[block.ground.index[rows], ["x", "y", "z"]] = values
    block.ground["role"] = system.roles
    block.track = block.track.iloc[:0]
    block.forget_folder()
    if effects:
        block = _with_effects(block, replicator, effects)
    truth = _truth(replicator, seed)
    truth["effects"] |= Values.of(block, effects).plain()
    return Simulated.of(block, truth)


def _with_effects(block: Block, replicator: Replicator, effects: Mapping[str, Mapping]) -> Block:
    """The block as measured with effects on top, which act where the adjusted model has it."""
    system, state = replicator.system, replicator.system.state
    slugs = [effect_of(name).slug for name in effects]
    doubled = [slug for slug in slugs if slug in system.effects]
    if doubled:
        raise InputError(f"effect {doubled[0]} is estimated already: it cannot come on top as well")
    there, order = block.copy(), np.argsort(system.image_order)
    quaternion = quaternion_from_rotation(state.rotation)[order]
    pose = np.concatenate([state.centre[order], quaternion], axis=1)
    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    there.images = there.images.assign(**dict(zip(names, pose.T, strict=True)))
    points = pd.DataFrame(state.points, columns=["x", "y", "z"])
    points.insert(0, "point", system.points.names)
    there.points = points
    there.cameras = {
        name: camera.with_interior(interior)
        for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
    }
    moved = add(there, effects)
    for table in ("tie_points", "marks", "gnss", "ground", "attitudes", "distances"):
        setattr(block, table, getattr(moved, table))
    return block


def _truth(replicator: Replicator, seed: int) -> dict:
    system, state = replicator.system, replicator.system.state
    noise, block, images = replicator.noise, system.block, system.images
    named, mark = system.points.names, system.points.mark

    def rows(names, values) -> dict:
        return dict(zip(list(names), np.asarray(values).tolist(), strict=True))

    ground = block.ground[["x", "y", "z"]].to_numpy(float).copy()
    at = pd.Index(named[mark]).get_indexer(block.ground["point"])
    seen = at >= 0
    ground[seen] = state.points[mark][at[seen]]
    order = np.argsort(system.image_order)
    cameras = {
        name: camera.with_interior(interior).to_table()
        for (name, camera), interior in zip(block.cameras.items(), state.interior, strict=True)
    }
    return {
        "block": block.name,
        "like": block.name,
        "seed": seed,
        "noise": {
            "tie_sigmas": noise.tie_sigma,
            "mark_sigmas": noise.mark,
            "control_sigmas": noise.control,
            "gnss": {
                f"{images.flight_names[f]}.{'xyz'[axis]}": {
                    "white_sigmas": noise.gnss.white[f, axis],
                    "slow_sigmas": noise.gnss.coloured[f, axis] / np.mean(noise.gnss.stated[at]),
                    "constant_s": noise.gnss.tau[f, axis],
                }
                for at, f, axis in (noise.gnss.blocks() if noise.gnss else ())
            },
        },
        "camera": cameras,
        "effects": system.values.plain(),
        "lever_arm": rows(images.flight_names, state.arms) if len(system.gnss.names) else {},
        "centre": rows(block.images["image"], state.centre[order]),
        "quaternion": rows(block.images["image"], quaternion_from_rotation(state.rotation)[order]),
        "ground": rows(block.ground["point"], ground),
        "points": rows(named[~mark], state.points[~mark]),
    }
