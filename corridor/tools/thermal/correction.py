"""A block's image points as they would be at the temperature of the calibration, and back."""

from collections.abc import Callable

import numpy as np

from corridor.core.block import Block, forget_correction, record_correction
from corridor.core.effects import Context, Images, find
from corridor.core.errors import InputError
from corridor.tools.thermal.model import ThermalModel
from corridor.tools.thermal.temperature import optics

_SLUG = "thermal"
_GRID = 21


def correct(block: Block, model: ThermalModel) -> tuple[Block, list[str]]:
    """The block with tie points and marks led back to the model's t0, and what is to be said of it.

    Each point is moved by the temperature of its image's optics (thermometer through the model's
    lag, flight by flight). The camera that belongs to the result is the camera at t0.
    Returns the block and warnings, one sentence each; the table `corrected` of its block.toml says
    what was done. Raises InputError where an image with points has no temperature, a camera's
    pictures are not of the model's size, or heat has been taken out before.
    Source: Zhou 2019, figure 6.2 and section 6.5.
    """
    out, notes = _moved(block, model, model.undo)
    done: dict = {"t0_c": model.t0_c, "kind": model.kind}
    if model.lag_s:
        done["lag_s"] = model.lag_s
    record_correction(out, {_SLUG: done}, notes)
    return out, notes


def uncorrect(block: Block, model: ThermalModel) -> tuple[Block, list[str]]:
    """The block as its warm camera sees it: undoes `correct`, and simulates the effect."""
    out, notes = _moved(block, model, model.displacement)
    forget_correction(out, _SLUG)
    return out, notes


def optics_of(block: Block, model: ThermalModel) -> np.ndarray:
    """Temperature of the optics at each image (images,), C; NaN where unknown."""
    warm = block.column("images", "temperature_c").copy()
    time = block.column("images", "time_s")
    if model.lag_s:
        flights = np.asarray(block.image_flight)
        for flight in np.unique(flights):
            rows = np.flatnonzero((flights == flight) & np.isfinite(time))
            warm[rows] = optics(time[rows], warm[rows], model.lag_s)
    return warm


def laboratory_prior(model: ThermalModel, block: Block) -> dict[str, tuple[float, float]]:
    """What the model says of the effect `thermal` in a block: value and sigma by name.

    For `corridor.adjust(block, effects=["thermal"], priors=...)`. The effect is straight in
    temperature and has four shapes; what it lacks of the model goes into the sigmas, px/C.
    Raises InputError as `correct` does.
    """
    _check(block, model)
    warm = optics_of(block, model)
    low, high = np.nanmin(warm), np.nanmax(warm)
    span = high - low
    if not span > 0:
        raise InputError(
            f"all images of block {block.name} have one temperature: the effect thermal needs two"
        )
    x, y = np.meshgrid(
        np.linspace(0, model.width - 1, _GRID), np.linspace(0, model.height - 1, _GRID)
    )
    names, shapes = _shapes(block, np.stack([x.ravel(), y.ravel()], axis=1))
    ends = [np.stack([d.ravel() for d in model.displacement(x, y, t)], axis=1) for t in (low, high)]
    slope = (ends[1] - ends[0]) / span
    design = shapes.reshape(-1, len(names))
    value, *_ = np.linalg.lstsq(design, slope.ravel(), rcond=None)
    lacks = float(np.sqrt(np.mean((slope.ravel() - design @ value) ** 2)))
    known = float(np.sqrt(sum(np.mean(model.sigma(x, y, t) ** 2) for t in (low, high))))
    # An error that is the same over the picture shows in each shape as its reach is to one.
    reach = np.sqrt(np.mean(shapes**2, axis=(0, 1)) * 2)
    sigma = np.hypot(lacks, known / span) / reach
    return {
        f"{_SLUG}.{name}": (float(v), float(s))
        for name, v, s in zip(names, value, sigma, strict=True)
    }


def _shapes(block: Block, pixel: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Parameters of the effect, and what each moves pixels (n, 2) by a degree, (n, 2, parameters).

    The effect is straight in temperature: its derivative in the warmest image of the block less
    that in the coldest, over the difference of their temperatures.
    """
    effect, images = find(_SLUG), Images.of(block)
    names = [parameter.name for parameter in effect.parameters(block)]
    none = np.zeros((len(pixel), len(names)))
    warm = images.temperature
    ends = [
        effect.shift(Context(images, np.full(len(pixel), image), pixel=pixel), none)[1]
        for image in (np.nanargmax(warm), np.nanargmin(warm))
    ]
    return names, (ends[0] - ends[1]) / (np.nanmax(warm) - np.nanmin(warm))


def _check(block: Block, model: ThermalModel) -> None:
    for name, camera in block.cameras.items():
        if (camera.width, camera.height) != (model.width, model.height):
            raise InputError(
                f"block.toml: camera {name} has pictures of {camera.width} x {camera.height} px, "
                f"the thermal model is of {model.width} x {model.height}: give the model of this "
                "camera"
            )
    if not block.has("images.temperature_c"):
        raise InputError(
            "images.csv has no temperature_c, which the thermal model needs: add the column"
        )


def _moved(
    block: Block, model: ThermalModel, shift: Callable[..., tuple[np.ndarray, np.ndarray]]
) -> tuple[Block, list[str]]:
    _check(block, model)
    warm = optics_of(block, model)
    out, notes = block.copy(), []
    used = np.zeros(len(warm), bool)
    for table in ("tie_points", "marks"):
        rows = getattr(out, table)
        if not len(rows):
            continue
        image = block.image_rows(table)
        used[image] = True
        unknown = np.flatnonzero(used & ~np.isfinite(warm))
        if len(unknown):
            raise InputError(
                f"{block.named('images', unknown[0])} has no temperature_c"
                + (f" (nor have {len(unknown) - 1} more)" if len(unknown) > 1 else "")
                + ": fill the cell or leave the image out"
            )
        x, y = rows["x"].to_numpy(float), rows["y"].to_numpy(float)
        dx, dy = shift(x, y, warm[image])
        rows["x"], rows["y"] = x + dx, y + dy
    concern = model.concern(warm[used])
    if concern:
        notes.append(concern)
    if model.lag_s and not block.has("images.time_s"):
        notes.append(
            f"images.csv has no time_s: the lag of {model.lag_s:.0f} s behind the thermometer is "
            "not applied"
        )
    return out, notes
