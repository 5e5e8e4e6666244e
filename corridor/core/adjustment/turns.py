"""Images that lie turned against their start poses: is it the picture that is turned, or the pose?

Either alone explains what start values show. The camera's principal point, the lever arm and its
distortion are turned with a picture, and not with a start pose: both are adjusted and compared.
"""

import numpy as np

from corridor.core.adjustment.result import Adjustment, Again, where_it_leads
from corridor.core.block import Block
from corridor.core.preparation import (
    quarters_of,
    turned_back,
    turned_by,
    turned_images,
    without_starts,
)

# Ratio of likelihoods from which on one of two is taken (Jeffreys 1961: decisive), as logarithm.
_DECISIVE = np.log(100.0)


def with_turns_as_seen(block: Block, again: Again) -> tuple[Block, list[str]]:
    """The block with turned images as the measurements say they are, and sentences on them.

    Turned back where that fits clearly better, else without their start poses, as where neither
    does: then the orientation is found anew from tie points.
    """
    angle = turned_by(block)
    turned = angle != 0.0
    if not turned.any():
        return block, []
    posed = without_starts(block, turned)
    back = turned_back(block, quarters_of(angle))
    found, other = (where_it_leads(again, one) for one in (back, posed))
    told = list(turned_images(block))
    if found and not other:
        # What cannot be computed says nothing of what is right.
        return back, [
            *told,
            "Their orientation cannot be computed from the tie points: nothing shows whether the "
            "pictures are turned or the start poses. The measurements are turned back here.",
        ]
    better = _log_odds(found, other)
    if better > _DECISIVE:
        return back, [
            *told,
            "Everything else fits better with these measurements turned back, and so they are "
            "turned back here: measure in the pictures as the camera wrote them.",
        ]
    end = "Their orientation is computed from the tie points"
    if better < -_DECISIVE:
        return posed, [*told, f"{end}: everything else fits better so; the start poses are wrong."]
    return posed, [*told, f"{end}; the measurements do not show whether the pictures are turned."]


def _log_odds(one: Adjustment | None, other: Adjustment | None) -> float:
    """Logarithm of the ratio of likelihoods of two fits of the same measurements."""
    if one is None or other is None:
        return 0.0
    return (other.cost - one.cost) / min(one.sigma0, other.sigma0) ** 2
