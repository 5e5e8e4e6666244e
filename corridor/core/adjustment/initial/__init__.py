"""Start values: every pose and every point that a block leaves open.

Poses come from resection on ground marks and on tie points that are known already, the best
supported image first. Where too little is known, a submodel starts from a pair of images in a frame
of its own and is brought to the ground points, poses and antenna positions it knows by a
similarity. Points are intersected from all rays that meet in them. None of this is more than a
start: the adjustment decides.
"""

from corridor.core.adjustment.initial.initialisation import complete

__all__ = ["complete"]
