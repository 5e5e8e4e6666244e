"""What changes at a moment and stays changed."""

from copy import copy

import numpy as np

from corridor.core.effects.context import Images
from corridor.core.effects.contract import LinearEffect


class AtMoments(LinearEffect):
    """at: times of the changes, s. By default `most` times, with as many images between any two, or
    between any two images where there are fewer."""

    most: int

    def __init__(self, group: str | None = None, at: tuple[float, ...] | None = None):
        super().__init__(group)
        self.at = at
        self.more: tuple[float, ...] = ()

    def with_moments(self, times: tuple[float, ...]) -> "AtMoments":
        """With other moments beside those that it has by itself."""
        out = copy(self)
        out.more = times
        return out

    def moments(self, images: Images) -> np.ndarray:
        """Times of the changes, s, none of them that of an image."""
        return np.union1d(self._own_moments(images), self.more)

    def _own_moments(self, images: Images) -> np.ndarray:
        if self.at is not None:
            return np.asarray(self.at, dtype=float)
        times = np.unique(images.time[np.isfinite(images.time)])
        if len(times) < 2:
            return np.zeros(self.most)
        after = self._first_after(times)
        return (times[after - 1] + times[after]) / 2

    def _first_after(self, times: np.ndarray) -> np.ndarray:
        """Which of the sorted times (n,), s, are the first ones after a change."""
        count = min(self.most, len(times) - 1)
        return np.round(np.linspace(0, len(times), count + 2)[1:-1]).astype(int)

    def happened(self, context) -> np.ndarray:
        """Which changes (rows, moments) are before the image of each row; NaN without a time."""
        time = context.images.time[context.image][:, None]
        return np.where(np.isnan(time), np.nan, time > self.moments(context.images))
