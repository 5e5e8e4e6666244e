"""What measurements and start values say of each other: where to look when nothing converged."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from corridor.core.adjustment.linear_system import LinearSystem
from corridor.core.block import along_axes
from corridor.core.camera import MODELS

_NAMED = 3
# What a drone's log misses: single-point GNSS, and attitudes of half a degree.
_LOG_M, _LOG_PX, _LOG_DEG = 10.0, 50.0, 10.0


def misfit(system: LinearSystem, far: bool = False) -> list[str]:
    """Sentences on how far the measurements lie from a state, and which lie farthest.

    far: only of measurements that lie farther off than the start values of a flight's log.
    """
    p, left = system.problem, system.residuals()
    out = []
    for what, names, metres in (
        ("GNSS positions", p.images.names[p.gnss_image], along_axes(p.gnss_turn, left.gnss)),
        (
            "control points",
            system.control_names,
            along_axes(p.control_turn[: len(left.control)], left.control),
        ),
    ):
        # A ground point that is its own start value says nothing.
        if metres.any() and (not far or np.median(np.linalg.norm(metres, axis=1)) > _LOG_M):
            out.append(_metres(what, names, metres))
    turned = np.degrees(np.linalg.norm(left.attitude, axis=1))
    if len(turned) and (not far or np.median(turned) > _LOG_DEG):
        names = p.images.names[p.attitude_image]
        worst = ", ".join(f"{names[k]} {turned[k]:.1f}" for k in np.argsort(-turned)[:_NAMED])
        out.append(
            f"Attitudes differ from the start values by {np.median(turned):.1f} degrees (median), "
            f"most at {worst}."
        )
    length = np.linalg.norm(left.pixels, axis=1)
    if far and np.nanmedian(length) < _LOG_PX:
        return out
    found = [np.nanmedian(length[p.img == k]) for k in range(p.image_count)]
    last = np.argsort(-np.nan_to_num(found, nan=np.inf))[:_NAMED]
    named = ", ".join(f"{p.images.names[k]} {found[k]:.0f} px" for k in last)
    out.append(
        f"Image points lie {np.nanmedian(length):.0f} px (median) from where the start values put "
        f"them; most in {named}."
    )
    return [*out, *_other_lenses(system, length)]


def _other_lenses(system: LinearSystem, length: np.ndarray) -> Iterator[str]:
    """Sentences on cameras with whose other model image points lie nearer, by more than half."""
    p = system.problem
    camera = p.images.camera[p.img]
    for k, (name, stated) in enumerate(p.block.cameras.items()):
        interior, other = system.state.interior.copy(), MODELS[1 - stated.fisheye]
        interior[k, -1] = 1.0 - stated.fisheye
        left = replace(system, state=replace(system.state, interior=interior)).residuals().pixels
        both = np.stack([length, np.linalg.norm(left, axis=1)])[:, camera == k]
        before, after = np.nanmedian(both, axis=1) if both.size else (0.0, 0.0)
        if after < before / 2 and before > _LOG_PX:
            yield (
                f"Through camera {name} they lie {before:.0f} px off, and {after:.0f} px with "
                f'model = "{other}" in [camera.{name}] of block.toml: which lens is it?'
            )


def _metres(what: str, names, left: np.ndarray) -> str:
    median = ", ".join(
        f"{axis} {value:+.2f} m" for axis, value in zip("xyz", np.median(left, 0), strict=True)
    )
    length = np.linalg.norm(left, axis=1)
    named = ", ".join(f"{names[k]} {length[k]:.2f} m" for k in np.argsort(-length)[:_NAMED])
    return (
        f"{what[:1].upper()}{what[1:]} minus what the start values predict: median {median}; most "
        f"at {named}."
    )
