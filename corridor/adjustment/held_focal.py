"""Whether the measurements contradict a focal length that block.toml calls calibrated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from corridor.adjustment.model import Model
from corridor.block import Block
from corridor.errors import AdjustmentFailed, InputError

if TYPE_CHECKING:
    from corridor.adjustment.result import Adjustment

# Residuals as large as they are stated to be say nothing against what is held.
_LARGE = 1.1
# Sigmas by which an estimate is another one; five, as of outliers.
_SIGMAS = 5.0
# Heat moves a focal length by less than a thousandth; a rolling shutter of 50 ms, which takes it
# along at 5 m/s, by a quarter of a metre of the 50 that a picture shows from as high.
_SHARE = 0.01


def held_focal(result: Adjustment, again: Callable[[Block, Model], Adjustment]) -> list[str]:
    """Sentences on calibrated focal lengths that are another one when they are estimated.

    A free lever arm takes up what a wrong focal length does at one flying height: residuals are
    small then, the ground is right, and nothing is said.
    again: an adjustment of a block with a model. It is asked for only where the residuals are
    larger than their standard deviations say, and starts where the first has ended.
    """
    p, model = result.problem, result.problem.model
    held = [
        name
        for name, camera in result.start.cameras.items()
        if camera.calibrated and "f" not in p.free.get(name, ())
    ]
    if not (result.converged and held and result.sigma0 > _LARGE and result.redundancy > 30):
        return []
    free = {
        name: ",".join(("f", *p.free.get(name, ()))) if name in held else p.free.get(name, ())
        for name in result.start.cameras
    }
    try:
        found = again(result.block, replace(model, camera=free))
    except (InputError, AdjustmentFailed):
        return []
    rows = found.camera[found.camera["parameter"] == "f"].set_index("camera")
    out = []
    for name in held if found.converged else ():
        stated, f, sigma = result.start.cameras[name]["f"], *rows.loc[name, ["value", "sigma"]]
        off = f - stated
        if abs(off) > max(_SIGMAS * sigma, _SHARE * stated):
            out.append(
                f"The focal length of camera {name} is held at {stated:.1f} px; estimated it comes "
                f"to {f:.1f} +- {sigma:.1f} px, {100 * abs(off) / stated:.1f} % "
                f"{'longer' if off > 0 else 'shorter'}, and sigma naught falls from "
                f"{result.sigma0:.2f} to {found.sigma0:.2f}: is it the calibration of another "
                "camera, focus or picture size? `--camera fraser8` estimates the camera."
            )
    return out
