"""Where and when an unknown peaks: in the picture, on the ground, in time.

The fitted group is evaluated where the block has data; nothing is known of it but its place.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from corridor.core.camera import without_distortion
from corridor.core.effects import Context, Stack
from corridor.diagnosis.forward_selection import Round
from corridor.diagnosis.settings import SETTINGS


def locate(one: Round, number: int, theta: np.ndarray) -> tuple[str, dict]:
    """A sentence and the location of the n-th group with parameters theta, in prior sigmas."""
    e = one.equations
    group = one.evidence.groups[number]
    effect, system = group.effect, e.system
    values = theta * group.scale
    control = list(system.control_names)
    stack = Stack(system.block, [effect], control, system.problem.stack.images)
    member = stack.members[effect.slug]
    images = system.images
    names = list(images.names) if effect.group == "image" else member.groups
    table = np.zeros((len(names), len(member.parameters)))
    columns = [q.name for q in member.parameters]
    position = {name: n for n, name in enumerate(names)}
    for (owner, name, _), value in zip(group.labels, values, strict=True):
        table[position[owner], columns.index(name)] = value
    if effect.place == "ground":
        return _ground(system, effect, control, table)
    if effect.group == "image":
        return _images(images, np.sqrt((table**2).sum(axis=1)), effect)
    if effect.place == "image":
        return _picture(system, stack, effect, table)
    every = np.arange(len(images.names))
    shift, _ = stack.evaluate(effect.place, Context(images, every), {effect.slug: table})
    return _time(images, shift, effect)


def _ground(system, effect, control, table) -> tuple[str, dict]:
    given = system.control.along_axes(system.control.given)
    context = Context(system.images, point=control, position=given)
    rows = np.broadcast_to(table, (len(given), table.shape[1]))
    shift, _ = effect.shift(context, rows)
    size = np.linalg.norm(shift - np.median(shift, axis=0), axis=1)
    worst = int(np.argmax(size))
    x, y = (float(v) for v in given[worst, :2])
    every = f", {1000 * np.sqrt(np.mean(size**2)):.0f} mm RMS of all" if len(table) > 1 else ""
    return (
        f"largest at control point {control[worst]}, x = {x:.0f} m, y = {y:.0f} m: "
        f"{1000 * size[worst]:.0f} mm{every}",
        {"x": x, "y": y},
    )


def _images(images, size, effect) -> tuple[str, dict]:
    worst = int(np.argmax(size))
    where: dict = {"flight": str(images.flight_names[images.flight[worst]])}
    share = size / max(size.max(), 1e-300)
    many = int((share > 0.3).sum())
    text = f"in {many} of {len(size)} images, largest in {images.names[worst]}"
    if np.isfinite(images.time[worst]):
        where["time_s"] = float(images.time[worst])
    if effect.place == "motion" or effect.by_row:
        where["row"] = "all"
    centre = np.average(images.centre, axis=0, weights=size**4)
    where |= {"x": float(centre[0]), "y": float(centre[1])}
    return text, where


def _picture(system, stack, effect, table) -> tuple[str, dict]:
    """Box of the picture in which the deformation, free of planes, is largest."""
    rows, images = system.image_rows, system.images
    step = max(len(rows.image) // 40_000, 1)
    pixel, image, point = (each[::step] for each in (rows.xy, rows.image, rows.point))
    ray = without_distortion(pixel, system.state.interior, images.camera[image])
    position = system.state.points[point]
    context = Context(images, image, pixel=pixel, ray=ray, position=position)
    shift, _ = stack.evaluate("image", context, {effect.slug: table})
    size = images.size[image]
    place = 2.0 * pixel / (size - 1) - 1.0
    design = np.column_stack([np.ones(len(place)), place])
    shift = shift - design @ np.linalg.lstsq(design, shift, rcond=None)[0]
    length = np.linalg.norm(shift, axis=1)
    cells = 2 * np.array(SETTINGS.places)
    cell = np.clip(((place + 1) / 2 * cells).astype(int), 0, cells - 1)
    flat = np.ravel_multi_index(cell.T, cells)
    count, total = (np.bincount(flat, weight, cells.prod()) for weight in (None, length))
    mean = np.where(count > 3, total / np.maximum(count, 1), 0.0).reshape(cells)
    pieces, _ = label(mean > SETTINGS.same_fit_share * mean.max())
    high = np.argwhere(pieces == pieces[np.unravel_index(np.argmax(mean), cells)])
    low, upto = high.min(axis=0), high.max(axis=0) + 1
    width = images.size[0] - 1
    box = np.concatenate([low / cells * width, upto / cells * width])
    where: dict = {
        "image": [float(v) for v in box],
        "most_px": float(mean.max()),
        "rms_px": float(np.sqrt(np.mean(length**2))),
    }
    text = (
        f"largest between x = {box[0]:.0f} and {box[2]:.0f} px, y = {box[1]:.0f} and "
        f"{box[3]:.0f} px: {mean.max():.2f} px"
    )
    time = images.time[image]
    if "images.time_s" in effect.needs and np.isfinite(time).all():
        worst = int(np.argmax(length))
        where["time_s"] = float(time[worst])
    return text, where


def _time(images, shift, effect) -> tuple[str, dict]:
    """The moment at which the curve changes fastest, in units of its own parts; of positions that
    jump there, by what."""
    moving = np.abs(shift).max(axis=0)
    weight = np.where(moving > 1e-3 * moving.max(initial=1e-300), 1.0, 0.0)
    away = (shift - shift.mean(axis=0)) * weight
    length = np.linalg.norm(away, axis=1)
    time = images.time
    if not np.isfinite(time).all():
        worst = int(np.argmax(length))
        return f"largest at image {images.names[worst]}", {
            "flight": str(images.flight_names[images.flight[worst]])
        }
    order = np.argsort(time, kind="stable")
    jump = np.linalg.norm(np.diff(away[order], axis=0), axis=1)
    k = int(np.argmax(jump))
    moment = float((time[order[k]] + time[order[k + 1]]) / 2)
    after = order[k + 1]
    flight = str(images.flight_names[images.flight[order[k]]])
    at = f"at {moment:.1f} s, flight {flight}, before image {images.names[after]}"
    where: dict = {"flight": flight, "time_s": moment}
    if not (hasattr(effect, "moments") and effect.place == "antenna"):
        return f"changes most {at}", where
    where["jump_m"] = (shift[after] - shift[order[k]]).tolist()
    return f"by ({', '.join(f'{value:+.2f}' for value in where['jump_m'])}) m {at}", where
