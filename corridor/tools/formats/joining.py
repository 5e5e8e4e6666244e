"""Why photographs could not be joined to the others, by what they say of themselves."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from corridor.core.block import Block
from corridor.core.photographs import FAULTS, Metadata, fault, open_picture
from corridor.tools.formats.focal import stated_focal
from corridor.tools.formats.heading import east_north
from corridor.tools.formats.placing import readout_of

_LOOKED_AT = 20  # pictures that are lost are read whole, which takes a while
# Features are joined within a few pixels: more motion than this in one picture bends it too much.
_BENT_PX, _BLURRED_PX = 8.0, 1.5
# Where the height above ground is not known: 8 px of 4 cm.
_BENT_M = 0.3
_LEAST_OVERLAP, _FARTHER = 0.5, 1.5
# Places are apart from so many times the usual way to the next photograph, and so many metres.
_PLACES_APART, _PLACES_APART_M = 20.0, 500.0
# Centres this many sigmas of GNSS from the positions, and this share of the block's extent.
_BENT_SIGMAS, _BENT_SHARE = 5.0, 0.03


def places_apart(photos: list[Metadata], names: list[str]) -> str | None:
    """A sentence where photographs lie in two places or more, far from each other; else None.

    names: of the photographs, for the sentence.
    """
    placed = [k for k, photo in enumerate(photos) if photo.lat_deg is not None]
    if len(placed) < 3:
        return None
    plan = east_north([photos[k] for k in placed])
    tree = minimum_spanning_tree(squareform(pdist(plan))).toarray()
    steps = tree[tree > 0]
    if not len(steps):
        return None
    limit = max(_PLACES_APART * float(np.median(steps)), _PLACES_APART_M)
    count, place = connected_components((tree > 0) & (tree < limit), directed=False)
    if count < 2:
        return None
    order = np.argsort(-np.bincount(place), kind="stable")
    members = [[names[placed[k]] for k in np.flatnonzero(place == one)] for one in order[:4]]
    told = "; ".join(f"{len(mine)} ({listed(mine, names)})" for mine in members)
    middles = [plan[place == one].mean(axis=0) for one in order[:2]]
    return (
        f"the photographs lie in {count} places, {np.hypot(*(middles[0] - middles[1])) / 1000:.1f} "
        f"km from each other: {told}; import each place by itself"
    )


def why_lost(photos: list[Metadata], joined: set[int]) -> str:
    """The likely reasons, as the end of a sentence.

    photos: all of them; joined: rows of those that are.
    """
    reasons = [*_damaged(photos, joined), *_motion(photos), *_overlap(photos, joined)]
    return "; ".join(reasons) or (
        "overlap or texture is too little, or the pictures are blurred: look at them"
    )


def _damaged(photos: list[Metadata], joined: set[int]) -> Iterator[str]:
    """Pictures whose pixels cannot all be read, of the first that are lost."""
    lost = [photo for row, photo in enumerate(photos) if row not in joined]
    yield from damaged([photo for photo in lost if photo.path.is_file()][:_LOOKED_AT])


def damaged(photos: list[Metadata]) -> Iterator[str]:
    """Pictures whose pixels cannot all be read: what is there of them may join nevertheless."""
    for photo in photos:
        try:
            with open_picture(photo.path) as picture:
                # A JPEG is decoded at an eighth, which is quick.
                picture.draft("L", (photo.width // 8, photo.height_px // 8))
                picture.load()
        except FAULTS as error:
            yield f"{photo.name} is damaged ({fault(error)}): copy it again"


def bent(block: Block) -> str | None:
    """Why the poses are no block's: they contradict the positions; None where they do not.

    A model that grew over pictures that do not fit reprojects well and is bent all the same.
    """
    if not len(block.gnss):
        return None
    rows = block.image_rows("gnss")
    there = rows >= 0
    centre = block.images[["x", "y", "z"]].to_numpy(float)[rows[there]]
    given, sigma = block.gnss[["x", "y", "z"]].to_numpy(float)[there], block.gnss_sigma()[there]
    away = np.linalg.norm(centre - given, axis=1)
    known = np.isfinite(away)
    if known.sum() < 4:
        return None
    typical = float(np.median(away[known]))
    stated = float(np.median(np.sqrt(np.mean(sigma[known] ** 2, axis=1))))
    extent = float(np.linalg.norm(np.ptp(given[known], axis=0)))
    if typical < _BENT_SIGMAS * stated or typical < _BENT_SHARE * extent:
        return None
    said = (
        f"the reconstruction is bent: its camera centres lie {typical:.0f} m (median) from the "
        f"positions of the photographs, which are stated to {stated:.1f} m"
    )
    speed = np.linalg.norm([block.column("images", axis) for axis in ("vx", "vy", "vz")], axis=0)
    readout = max((camera.readout_s or 0.0 for camera in block.cameras.values()), default=0.0)
    moved = float(np.nanmedian(speed)) * readout if np.isfinite(speed).any() else 0.0
    if moved > _BENT_M:
        said += (
            f"; the drone moved {moved:.1f} m (median) while one picture was read out "
            f"({1000 * readout:.0f} ms), which bends every picture otherwise"
        )
    return said


def _motion(photos):
    """Motion while one picture was read out, and while it was exposed."""
    speed = [float(np.linalg.norm(p.velocity)) for p in photos if p.velocity is not None]
    if not speed:
        return
    pixel = _metres_a_pixel(photos)
    fastest = float(np.percentile(speed, 90))
    low, high = np.percentile(speed, [10, 90])
    readout, _ = readout_of(photos[0], photos[0].height_px)
    if readout and fastest * readout > (_BENT_M if pixel is None else _BENT_PX * pixel):
        moved = low * readout, high * readout
        in_px = "" if pixel is None else f", {moved[0] / pixel:.0f} to {moved[1] / pixel:.0f} px"
        yield (
            f"the drone moved {moved[0]:.1f} to {moved[1]:.1f} m{in_px} while one "
            f"picture was read out ({1000 * readout:.0f} ms at {low:.0f} to {high:.0f} m/s), which "
            "bends every picture otherwise"
        )
    exposed = [p.exposure_s for p in photos if p.exposure_s]
    if exposed and pixel and fastest * np.median(exposed) > _BLURRED_PX * pixel:
        yield (
            f"the motion during the exposure ({1000 * np.median(exposed):.1f} ms) blurs "
            f"{fastest * np.median(exposed) / pixel:.1f} px"
        )


def _metres_a_pixel(photos):
    # Above the place of take-off, m, as some makers write it.
    heights = [h for p in photos if (h := p.number("RelativeAltitude")) and h > 1]
    focal = stated_focal(photos[0])
    return float(np.median(heights)) / focal.px if heights and focal else None


def _overlap(photos, joined):
    placed = [k for k, photo in enumerate(photos) if photo.lat_deg is not None]
    lost = np.array([k not in joined for k in placed])
    if len(placed) < 3 or not lost.any():
        return
    plan = east_north([photos[k] for k in placed])
    apart = np.linalg.norm(plan[:, None] - plan[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    # A model grows from picture to picture: the second neighbour decides.
    gap = np.partition(apart, 1, axis=1)[:, 1]
    pixel = _metres_a_pixel(photos)
    if pixel is not None:
        side = pixel * np.sqrt(photos[0].width * photos[0].height_px)
        overlap = 1 - float(np.median(gap[lost])) / side
        if overlap < _LEAST_OVERLAP:
            yield f"they overlap their neighbours by about {100 * max(overlap, 0):.0f} % only"
    elif not lost.all() and np.median(gap[lost]) > _FARTHER * np.median(gap[~lost]):
        yield (
            f"they lie {np.median(gap[lost]):.0f} m from their neighbours, the others "
            f"{np.median(gap[~lost]):.0f} m"
        )


def listed(names: list[str], order: list[str]) -> str:
    """Names with runs in the order of the photographs drawn together: A to C, F."""
    at = {name: k for k, name in enumerate(sorted(order))}
    runs: list[list[str]] = []
    for name in sorted(names):
        if runs and at[name] == at[runs[-1][-1]] + 1:
            runs[-1].append(name)
        else:
            runs.append([name])
    told = [run[0] if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs]
    return ", ".join(told[:10]) + (", ..." if len(told) > 10 else "")
