"""Where the cameras stand and what they see: footprints in plan, and the flight in space."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from corridor.core.block import Block, corner_rays, footprints
from corridor.core.output import short
from corridor.interface.figures import maps, style

MOST_IMAGES, MOST_FOOTPRINTS = 600, 12
_LINES = ("-", "--", ":", "-.")


def camera_views(block: Block) -> Figure:
    """Footprints of the pictures in plan, and the cameras over the ground from the side.

    block: its poses as they stand; one in so many where there are more than 600, and footprints
    of a dozen, which cannot be told apart otherwise. They are on a plane at the mean height of
    the points. In space a camera is a pyramid that opens towards what it sees, 4 m high; heights
    and distances have one scale.
    """
    title = f"{short(block.name, 60)}: what the cameras see"
    pose = block.poses
    known = np.isfinite(pose).all(axis=1)
    if not known.any():
        return style.sentence("No pose is known yet: the adjustment finds start values.", title)
    frame = maps.frame_of(block)
    parts = [(name, rows[known[rows]], *look) for name, rows, *look in maps.group_styles(block)]
    step = -(-int(known.sum()) // MOST_IMAGES)
    note = f"one image in {step} is drawn" if step > 1 else ""
    drawn = -(-int(known.sum()) // MOST_FOOTPRINTS)
    if drawn > step:
        note = "; ".join(filter(None, (note, f"footprints of one image in {drawn}")))
    level = float(np.nanmean(block.points["z"])) if len(block.points) else 0.0
    away, seen = corner_rays(block), footprints(block, level)[:, :, :2]
    flat = frame.place(seen.reshape(-1, 2)).reshape(seen.shape)
    limits = maps.extent(flat.reshape(-1, 2), frame.place(pose[known, :2]))
    height = maps.map_height(limits, 8.5, 4.0)
    figure = style.sheet(1.15 + height + 0.5 + 3.9, title, note)
    axes = maps.map_panel(figure, frame, limits, 0.8, 1.15, 8.5, height)
    keys = []
    for k, (name, rows, colour, marker) in enumerate(parts):
        dashes = _LINES[k % len(_LINES)]
        outline = np.concatenate([flat[rows], flat[rows][:, :1]], axis=1)[:: max(drawn, step)]
        rows = rows[::step]
        axes.add_collection(
            LineCollection(outline, colors=colour, linewidths=0.9, linestyles=dashes)
        )
        axes.plot(*frame.place(pose[rows, :2]).T, ls="", marker=marker, ms=3, color=colour)
        keys.append(style.key(name, ls=dashes, lw=0.9, marker=marker, ms=5, color=colour))
    keys += maps.draw_ground(axes, frame, block, names=False)
    style.legend(figure, 0.87, keys)
    box = (0.05, 0.0, 0.9, 3.9 / figure.get_size_inches()[1])
    axes = figure.add_axes(box, projection="3d", facecolor="white", computed_zorder=False)
    flown = [(rows[::step], colour) for _, rows, colour, _ in parts]
    _space(axes, block, frame, flown, pose, away, level)
    return figure


def _space(axes, block, frame, drawn, pose, away, level):
    along = frame.place(pose[:, :2])
    every = np.concatenate([maps.columns(t, ("x", "y", "z")) for t in (block.points, block.ground)])
    ground, heights = frame.place(every[:, :2]), every[:, 2]
    inside = np.isfinite(ground).all(axis=1) & np.isfinite(heights)
    span = np.array([np.nanmin(along, axis=0) - 25, np.nanmax(along, axis=0) + 25])
    inside &= ((ground > span[0]) & (ground < span[1])).all(axis=1)
    few = np.flatnonzero(inside)[:: -(-int(inside.sum()) // 2500) or 1]
    axes.plot(*ground[few].T, heights[few], zorder=1, **style.dot("o", "#9a9a9a", 0.9, "none"))
    for rows, colour in drawn:
        centre = np.column_stack([along[rows], pose[rows, 2]])
        rays = away[rows]
        turned = frame.turn(rays[:, :, :2].reshape(-1, 2)).reshape(*rays.shape[:2], 2)
        tips = centre[:, None] + 4.0 * np.concatenate([turned, rays[:, :, 2:]], axis=2)
        ends = np.repeat(centre[:, None], tips.shape[1], axis=1)
        edges = np.stack([ends, tips], axis=2).reshape(-1, 2, 3)
        ring = np.stack([tips, np.roll(tips, -1, axis=1)], axis=2).reshape(-1, 2, 3)
        axes.add_collection3d(
            Line3DCollection(np.concatenate([edges, ring]), colors=colour, linewidths=0.6, zorder=4)
        )
    top_z = np.nanmax(pose[:, 2]) + 3
    axes.set(xlim=span[:, 0], ylim=span[:, 1], zlim=(level - 3, top_z))
    axes.set_box_aspect((*np.ptp(span, axis=0), top_z - level + 3), zoom=1.2)
    axes.view_init(elev=18, azim=-72)
    axes.tick_params(labelsize=style.SMALL, colors=style.INK, pad=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set(facecolor="white", edgecolor=style.FAINT)
        axis._axinfo["grid"].update(color=style.FAINT, linewidth=0.3)
    x_name, y_name = frame.labels
    axes.set_xlabel(x_name, size=style.TEXT, labelpad=14)
    axes.set_ylabel(y_name, size=style.TEXT, labelpad=4)
    axes.set_zlabel("height (m)", size=style.TEXT, labelpad=0)
    axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="z", nbins=4)
