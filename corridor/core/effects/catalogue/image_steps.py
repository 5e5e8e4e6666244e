"""The picture is shifted on one side of a line: a pane, a crack, a sensor of two halves.

Source: this project (a shape for what no named effect explains).
"""

import numpy as np

from corridor.core.effects.contract import AlongAxes, Parameter

# Lines that a step may follow, upright and level, evenly spaced over the picture, and the share of
# their distance over which it rises: an adjustment needs a slope to go by.
UPRIGHT, LEVEL = 15, 11
RISE = 1.0


class ImageSteps(AlongAxes):
    slug = "image_steps"
    title = "Sudden shifts of the picture across upright and level lines"
    called = "a sudden shift within the picture, the same in all images"
    place = "image"
    group = "camera"
    generic = True
    sudden = True
    revealed_by = "many tie points that are seen on both sides of the line"
    unobservable_when = "the points of one side are hardly ever seen on the other"

    def parameters(self, block):
        lines = range(1, UPRIGHT + LEVEL + 1)
        return [Parameter(f"{axis}_{line}", "px", scale=0.5) for axis in "xy" for line in lines]

    def terms(self, context):
        """dx = sum of x_line times the side (-1/2 to 1/2), upright lines first, dy alike."""
        share = context.pixel / (context.size - 1)
        sides = [_side(share[:, 0], UPRIGHT), _side(share[:, 1], LEVEL)]
        return np.hstack(sides)

    def moved(self, context, values):
        share = context.pixel / (context.size - 1)
        return _moved(share[:, 0], values[:UPRIGHT]) + _moved(share[:, 1], values[UPRIGHT:])


def _side(share: np.ndarray, lines: int) -> np.ndarray:
    """-1/2 before each line, 1/2 behind it, with a smooth rise (n, lines)."""
    return _risen(share[:, None] * (lines + 1) - np.arange(1, lines + 1))


def _risen(away: np.ndarray) -> np.ndarray:
    t = np.clip(away / RISE + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t) - 0.5


def _moved(share: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sides times values (lines, 2): of all lines but the nearest a place (n,) is on one side."""
    at = share * (len(values) + 1)
    nearest = np.clip(np.rint(np.nan_to_num(at)), 1, len(values)).astype(int)
    behind = np.cumsum(values, axis=0)
    others = behind - values / 2.0 - behind[-1] / 2.0
    return others[nearest - 1] + _risen(at - nearest)[:, None] * values[nearest - 1]
