"""Pictures of a change: maps of it, its sigma and significance, the profile, named points.

change: a `corridor.change.Change`, surface: its `SurfaceChange`, points: its `PointChanges`.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from corridor.interface.figures import maps, style

_BOTH = style.SIGNED


def of_change(change) -> dict[str, tuple[Figure, str]]:
    """Every picture of a change with its caption, by the name of its file."""
    out = {}
    if change.surface is not None and len(change.surface):
        out["surface"] = (
            change_maps(change.surface),
            "Change along the normal, second date minus first; its level of detection (95 %), "
            "errors that points share included; what is significant at the false discovery rate "
            "asked for.",
        )
        out["profile"] = (
            change_profile(change.surface),
            "The same along the corridor: core points, the mean over its width, and the level of "
            "detection of a single core point (95 %).",
        )
    if change.points is not None:
        out["points"] = (
            point_changes(change.points),
            "Displacements of named points with their standard deviations.",
        )
    return out


def change_maps(surface) -> Figure:
    """Maps of the change, of its level of detection and of what is significant."""
    z = np.clip(surface.distance / surface.total, -6, 6)
    name = "what is significant, in its standard deviations"
    sure = _Panel(name, z, _BOTH, 6.0, "sigmas", surface.moved)
    return _maps(surface, "change of the surface", [_change(surface), _detection(surface), sure])


def change_map(surface) -> Figure:
    """The change alone, as a program shows it that does not know how sure it is."""
    return _maps(surface, "change of the surface", [_change(surface)])


def detection_map(surface) -> Figure:
    """What could be seen, before any change is asked for: so, and with points everywhere."""
    panels = [_detection(surface)]
    if surface.sampling.any():
        floor = 1000 * surface.floor
        alone = "with points everywhere: the measurements alone, 95 %"
        panels.append(_Panel(alone, floor, style.COUNTS, float(np.percentile(floor, 98)), "mm"))
    return _maps(surface, "where a change could be seen", panels)


@dataclass(frozen=True)
class _Panel:
    """A map: value (k,) by colours from zero, or both ways, to `largest`; shown (k,): others are
    empty cells."""

    name: str
    value: np.ndarray
    colours: Colormap
    largest: float
    unit: str
    shown: np.ndarray | None = None

    @property
    def limits(self) -> dict:
        """Of the colours, for matplotlib."""
        low = -self.largest if self.colours is _BOTH else 0.0
        return {"norm": Normalize(low, self.largest)}


def _change(surface) -> _Panel:
    largest = max(float(np.percentile(np.abs(surface.distance), 99)), 1e-4)
    return _Panel("change", 1000 * surface.distance, _BOTH, 1000 * largest, "mm")


def _detection(surface) -> _Panel:
    largest = 1000 * float(np.percentile(surface.detection, 98))
    return _Panel("level of detection, 95 %", 1000 * surface.detection, style.COUNTS, largest, "mm")


def _maps(surface, title: str, panels: list[_Panel]) -> Figure:
    frame = maps.frame_through(surface.cores.xyz[:, :2], "y")
    cells = frame.place(surface.cores.cells).reshape(-1, 4, 2)
    limits = maps.extent(cells)
    width = 8.0
    height = maps.map_height(limits, width, 3.4)
    step = height + 0.75
    note = f"{len(surface):,} core points, cylinders of {surface.cores.radius:.1f} m radius"
    if any(panel.colours is _BOTH for panel in panels):
        note += " \u00b7 yellow: lower, hatched from one standard deviation on; blue: higher"
    figure = style.sheet(1.0 + len(panels) * step, title, note)
    for row, panel in enumerate(panels):
        top = 1.05 + row * step
        axes = maps.map_panel(figure, frame, limits, 0.65, top, width, height)
        if panel.shown is not None:
            axes.add_collection(
                PolyCollection(cells, facecolor="none", edgecolor=style.FAINT, lw=0.3)
            )
        some = slice(None) if panel.shown is None else panel.shown
        image = PolyCollection(
            cells[some], array=panel.value[some], cmap=panel.colours, edgecolor="face", lw=0.2,
            **panel.limits,
        )  # fmt: skip
        axes.add_collection(image)
        if panel.colours is _BOTH:
            sure = np.where(np.abs(surface.distance) > surface.total, panel.value, 0.0)[some]
            style.hatch_below(axes, cells[some], sure)  # Of others nobody knows the sign.
        style.caption(axes, panel.name)
        if row < len(panels) - 1:
            axes.set_xlabel("")
        tall = max(height - 0.75, 0.5)
        style.shade_bar(figure, image, 0.65 + width + 0.2, top + height - tall, tall, panel.unit)
    return figure


def change_profile(surface, bins: int = 60) -> Figure:
    """Change along the corridor: core points, the mean of each stretch, the level of detection."""
    station, change = surface.cores.station, 1000 * surface.distance
    edges = np.linspace(
        station.min(), station.max() + 1e-9, min(bins, max(len(change) // 4, 1)) + 1
    )
    which = np.clip(np.digitize(station, edges) - 1, 0, len(edges) - 2)
    count = np.bincount(which, minlength=len(edges) - 1)
    filled = count > 0
    middle = 0.5 * (edges[1:] + edges[:-1])[filled]

    def mean(value):
        return np.bincount(which, value, minlength=len(edges) - 1)[filled] / count[filled]

    keys = [
        style.key("core points", **style.dot(".", style.QUIET, 3.0)),
        style.key("mean across", color=style.DARK, lw=1.4),
        style.key("level of detection of a core point, 95 %", color=style.LIGHT, lw=1.2, ls="--"),
    ]
    figure, panels = style.charts("change along the corridor", "", [3.0], keys=keys)
    axes = panels[0, 0]
    axes.plot(station, change, zorder=1, **style.dot(".", style.QUIET, 2.5, line=0.0))
    axes.plot(middle, mean(change), color=style.DARK, lw=1.4, zorder=4)
    limit = mean(1000 * surface.detection)
    for sign in (1, -1):
        axes.plot(middle, sign * limit, color=style.LIGHT, lw=1.2, ls="--", zorder=3)
    most = float(max(np.percentile(np.abs(change), 99.0), np.median(limit)) * 1.3)
    axes.set_ylim(-most, most)
    axes.axhline(0.0, color=style.QUIET, lw=0.5, zorder=2)
    style.label(axes, "station (m)", "change (mm)")
    return figure


def point_changes(points) -> Figure:
    """Displacements of named points, an axis a panel, with two standard deviations."""
    names = [str(name) for name in points.names]
    keys = [
        style.key("moved", **style.dot("s", style.MIDDLE)),
        style.key("moved, or an effect", **style.dot("D", style.MIDDLE)),
        style.key("stable", **style.dot("o", style.DARK)),
        style.key("held as control", **style.dot("^", style.FAINT)),
    ]
    either = np.zeros(len(names), bool) if points.undecided is None else points.undecided
    if not either.any():
        del keys[1]
    shapes = np.where(points.held, "^", np.where(points.moved, "s", np.where(either, "D", "o")))
    colours = np.where(points.moved | either, style.MIDDLE, style.DARK)
    colours = np.where(points.held, style.FAINT, colours)
    title, note = "displacements of named points", "bars: two standard deviations"
    figure, panels = style.charts(title, note, [2.6], 3, keys, sharex=True, sharey=True)
    row = np.arange(len(names))
    for axis, axes in enumerate(panels[0]):
        d, s = 1000 * points.shift[:, axis], 1000 * points.sigma[:, axis]
        for k in row:
            axes.plot([d[k] - 2 * s[k], d[k] + 2 * s[k]], [k, k], color=colours[k], lw=1.2)
            axes.plot(d[k], k, **style.dot(shapes[k], colours[k], 4.0))
        axes.axvline(0.0, color=style.QUIET, lw=0.5, zorder=0)
        style.label(axes, f"d{'xyz'[axis]} (mm)")
        axes.set_ylim(len(names) - 0.5, -0.5)
    few = row[:: max(len(row) // 25, 1)]
    panels[0, 0].set_yticks(few, [names[k] for k in few], parse_math=False)
    return figure
