"""How heat moves the picture: deformation maps, the similarity against temperature, two cameras."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from corridor.core.output import nice, readable, short
from corridor.interface.figures import style
from corridor.interface.figures._residual_vectors import arrows, stated_arrow

if TYPE_CHECKING:
    from corridor.tools.thermal import CameraDifference, Fit, Maps

# The lighter half of the counts: arrows show on it in grey print too.
_PALE = style.COUNTS.resampled(256).from_list("corridor_pale", style.COUNTS(np.linspace(0, 0.5)))
# Inches: beside the maps, between two, and for the key of a scale.
_LEFT, _GAP, _KEY = 0.75, 0.45, 0.95


def deformation_maps(maps: Maps, picture: int | None = None, null: int | None = None) -> Figure:
    """Deformation of one picture, and what is measured where there should be none.

    maps: of a series. picture: row; default the one that moved most. null: row of the null map;
    default the usable picture, not the reference itself, with the temperature nearest to it.
    Upper row dx, dy less their means, on one scale, and arrows of the whole; lower row dx, dy of
    the null map on one scale, and the predicted sigma of the first picture on its own, from zero.
    px; nodes that are not valid stay white, what is below zero is hatched.
    """
    title = "Deformation maps"
    usable = np.flatnonzero(maps.valid.any(axis=1))
    own = maps.reference & (np.count_nonzero(maps.reference) == 1)
    usable = usable[~own[usable]]
    if not len(usable):
        return style.sentence("No picture could be matched.", title)
    length = np.hypot(maps.dx, maps.dy)
    if picture is None:
        picture = int(usable[np.argmax(np.nanmean(length[usable], axis=1))])
    if null is None:
        null = _nearest(maps, usable)
    wide = (style.WIDTH - _LEFT - _GAP - 2 * _KEY) / 3
    tall = min(wide * maps.height / maps.width, 1.3 * wide)
    row = tall + 0.95
    note = f"{_note(maps, picture)} \u00b7 null map: {_note(maps, null)} \u00b7 hatched: below zero"
    figure = style.sheet(1.15 + 2 * row, f"{title}: {short(maps.picture[picture], 40)}", note)
    measured = {}
    for name, values in (("dx", maps.dx[picture]), ("dy", maps.dy[picture])):
        mean = float(np.nanmean(values))
        measured[f"{name} less its mean of {mean:+.2f} px"] = values - mean
    calm = {
        f"null map ({short(maps.picture[null], 18)}): dx": maps.dx[null],
        "null map: dy": maps.dy[null],
    }
    left = [_LEFT, _LEFT + wide + _GAP, style.WIDTH - _KEY - wide]
    for top, fields in ((1.15, measured), (1.15 + row, calm)):
        norm = _about_zero(fields.values())
        for k, (name, values) in enumerate(fields.items()):
            axes = style.panel(figure, left[k], top, wide, tall)
            image = _field(axes, maps, values, norm, name, k == 0)
        style.shade_bar(figure, image, left[1] + wide + 0.15, top, tall, "px")
    axes = style.panel(figure, left[2], 1.15 + row, wide, tall)
    sigma = maps.sigma[picture]
    norm = Normalize(0, 1.02 * float(np.nanpercentile(sigma, 99.5)) + 1e-9)
    image = _field(axes, maps, sigma, norm, "predicted sigma", False, style.COUNTS)
    style.shade_bar(figure, image, left[2] + wide + 0.15, 1.15 + row, tall, "px")
    axes = style.panel(figure, left[2], 1.15, wide, tall)
    _vectors(figure, axes, maps, picture, left[2], 1.15, wide)
    return figure


def thermal_parameters(fit: Fit) -> Figure:
    """The similarity of each picture against temperature, with the model, and what is left.

    fit: of `corridor.thermal.fit`. Warm-up and cool-down have their own colours and markers; the
    line is the model. Below it what the model leaves of each picture, and the temperatures.
    """
    model, table = fit.model, fit.pictures[fit.pictures["used"]]
    note = (
        f"{model.kind}, powers of T up to {len(model.dx)} \u00b7 {model.residual_px:.4f} px RMS "
        f"left \u00b7 zero at {model.t0_c:.1f} \u00b0C"
    )
    if model.lag_s is not None:
        note += f" \u00b7 the optics lag {model.lag_s:.0f} s"
    states = (("warming", ~table["cooling"]), ("cooling", table["cooling"]))
    parts = [
        (name, of, style.dot(marker, colour, 3.5, style.INK, 0.2))
        for (name, of), (colour, marker) in zip(states, style.SERIES, strict=False)
    ]
    optics = {"color": style.INK, "lw": 1.2}
    thermometer = {"color": style.MIDDLE, "lw": 1.0, "ls": "--"}
    keys = [style.key(name, **look) for name, of, look in parts if of.any()]
    keys += [style.key("model, optics", **optics), style.key("thermometer", **thermometer)]
    figure, panels = style.charts("Heat and the picture", note, [2.925] * 2, 3, keys)
    line = np.linspace(*model.range_c, 101)
    curve = model.parameters(line)
    named = {
        "shift_x": "shift in x (px)",
        "shift_y": "shift in y (px)",
        "scale": "scale (ppm)",
        "rotation": "rotation (\u00b5rad)",
    }
    for axes, (key, name) in zip(panels[:, :2].flat, named.items(), strict=True):
        for _, of, look in parts:
            axes.plot(table["optics_c"][of], table[key][of], zorder=3, **look)
        axes.plot(line, curve[key], zorder=2, **optics)
        style.label(axes, "temperature of the optics (\u00b0C)", name)
    # A microradian is a millionth of the distance from the middle, as a ppm of the scale is.
    least = 0.1 * max(map(abs, panels[1, 0].get_ylim()))
    low, high = panels[1, 1].get_ylim()
    panels[1, 1].set_ylim(min(low, -least), max(high, least))
    left, temperatures = panels[:, 2]
    time = table["time_s"] / 60
    for _, of, look in parts:
        left.plot(time[of], table["residual_px"][of], **look)
    left.set_ylim(bottom=0)
    style.label(left, "time (min)", "residual (px)")
    order = np.argsort(time.to_numpy(), kind="stable")
    temperatures.plot(time.iloc[order], table["thermometer_c"].iloc[order], **thermometer)
    temperatures.plot(time.iloc[order], table["optics_c"].iloc[order], **optics)
    style.label(temperatures, "time (min)", "temperature (\u00b0C)")
    return figure


def camera_difference(difference: CameraDifference, title: str = "Two cameras") -> Figure:
    """Where the second camera sees what the first sees, as arrows over the distance in colour.

    difference: of `corridor.thermal.compare_cameras`, px; the best rotation is taken out.
    """
    wide = 6.2
    tall = wide * difference.height / difference.width
    figure = style.sheet(1.2 + tall + 0.6, title, str(difference), width=8.2)
    axes = style.panel(figure, _LEFT, 1.2, wide, tall)
    x, y = np.unique(difference.x), np.unique(difference.y)
    shape = len(y), len(x)
    norm, length = Normalize(0, max(difference.largest, 1e-12)), difference.length.reshape(shape)
    image = axes.pcolormesh(x, y, length, cmap=_PALE, norm=norm, shading="nearest")
    step = max(1, len(x) // 14)
    pick = np.zeros(shape, bool)
    pick[step // 2 :: step, step // 2 :: step] = True
    pick = pick.ravel()
    space = step * (x[1] - x[0])
    exaggeration = nice(space / max(difference.largest, 1e-12))
    shown = (getattr(difference, name)[pick] for name in ("x", "y", "dx", "dy"))
    arrows(axes, *shown, exaggeration, style.INK)
    _frame(axes, difference, True)
    style.shade_bar(figure, image, _LEFT + wide + 0.2, 1.2, tall, "distance (px)")
    size = nice(0.8 / (wide / difference.width * exaggeration))
    inches = size * exaggeration * wide / difference.width
    stated_arrow(figure, _LEFT, 0.93, inches, f"{readable(size)} px")
    return figure


def _nearest(maps, usable):
    """The usable picture whose temperature is nearest to the reference's."""
    warm = maps.temperature_c
    if not np.isfinite(warm[usable]).any() or not np.isfinite(warm[maps.reference]).any():
        return int(usable[np.argmin(np.nanmean(np.hypot(maps.dx, maps.dy)[usable], axis=1))])
    away = np.abs(warm[usable] - np.nanmean(warm[maps.reference]))
    return int(usable[np.nanargmin(away)])


def _note(maps, picture):
    warm = maps.temperature_c[picture]
    parts = [f"{100 * maps.valid[picture].mean():.0f} % of {maps.valid.shape[1]:,} nodes valid"]
    if np.isfinite(warm):
        cold = maps.temperature_c[maps.reference]
        if np.isfinite(cold).any():
            parts.insert(0, f"{warm:.1f} \u00b0C against {np.nanmean(cold):.1f} \u00b0C")
    return " \u00b7 ".join(parts)


def _about_zero(fields):
    """One scale for all fields, zero in its middle."""
    values = np.concatenate([field[np.isfinite(field)] for field in fields])
    # A few wild nodes must not wash out the rest.
    most = float(np.abs(np.percentile(values, [0.5, 99.5])).max())
    most = 1.02 * most + 1e-9
    return Normalize(-most, most)


def _field(axes: Axes, maps, values, norm, name, first, colours=style.SIGNED):
    x, y = np.unique(maps.x), np.unique(maps.y)
    grid = np.full((len(y), len(x)), np.nan)
    grid[np.searchsorted(y, maps.y), np.searchsorted(x, maps.x)] = values
    image = axes.pcolormesh(x, y, grid, cmap=colours, norm=norm, shading="nearest")
    if colours is style.SIGNED and len(x) > 1 and len(y) > 1:
        edges = (np.append(at - np.diff(at)[0] / 2, at[-1] + np.diff(at)[-1] / 2) for at in (x, y))
        style.hatch_below(axes, style.cells_of(*edges), np.nan_to_num(grid).ravel())
    style.caption(axes, name)
    _frame(axes, maps, first)
    return image


def _vectors(figure, axes, maps, picture, left, top, wide):
    dx, dy = maps.dx[picture], maps.dy[picture]
    columns = len(np.unique(maps.x))
    step = max(1, columns // 7)
    order = np.lexsort((maps.x, maps.y))
    place = np.empty(len(order), int)
    place[order] = np.arange(len(order))
    inner = step // 2
    pick = (place % columns % step == inner) & (place // columns % step == inner)
    pick &= np.isfinite(dx)
    longest = max(float(np.nanmax(np.hypot(dx, dy))), 1e-12)
    exaggeration = nice(0.75 * step * maps.width / columns / longest)
    style.caption(axes, "dx and dy")
    arrows(axes, maps.x[pick], maps.y[pick], dx[pick], dy[pick], exaggeration, style.DARK)
    _frame(axes, maps, False)
    inch = wide / maps.width
    size = nice(longest)
    length = size * exaggeration * inch
    stated_arrow(figure, left + wide - length - 0.5, top - 0.13, length, f"{readable(size)} px")


def _frame(axes, picture, first):
    style.in_pixels(axes, picture, outlined=True)
    if not first:
        axes.set_ylabel("")
    axes.tick_params(labelleft=first)  # beside it stand the same rows, or a scale
