"""The points in pieces, which threads take in turn."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from corridor.core.adjustment.problem import Problem

# Shares of the observations for two threads. A processor may be half as fast as its neighbour for
# a while: the last pieces are small, so that neither waits for the other long.
# Source: Hummel, Schonberg and Flynn 1992, "Factoring", Communications of the ACM 35(8).
_SHARES = np.repeat([1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 32], 2)
# Fewer observations are done before a thread has asked for them.
_LEAST = 20_000


@dataclass(frozen=True)
class Pieces:
    """Points of which each piece adds to images of its own.

    point, image (k + 1,): where pieces begin and the last ends; a point is of the piece in whose
    images it begins; images of one exposure count as one. spare: how many images further a point
    reaches. What a piece adds to images of the next ones lies apart, in `apart` rows behind those
    of all images, until `fold`.
    """

    point: list[int]
    image: list[int]
    spare: int
    threads: int

    @classmethod
    def of(cls, p: Problem, threads: int) -> "Pieces":
        """For one thread, or two."""
        count = len(p.ptr) - 1
        point, image = [0], [0]
        first = p.exposure[p.img[p.ptr[:-1]]]
        for share in np.cumsum(_SHARES)[:-1] if threads > 1 else ():
            at = int(np.searchsorted(p.ptr, share * p.ptr[-1]))
            if at < count:
                begins = int(first[at])
                at = int(np.searchsorted(first, begins))
                left, right = p.ptr[at] - p.ptr[point[-1]], p.ptr[-1] - p.ptr[at]
                if begins > image[-1] and min(left, right) >= _LEAST:
                    point.append(at)
                    image.append(begins)
        return cls([*point, count], [*image, p.exposure_count], p.bandwidth, threads)

    def __len__(self) -> int:
        return len(self.point) - 1

    @property
    def apart(self) -> int:
        """Rows behind those of all images."""
        return (len(self) - 1) * self.spare

    def shift(self, piece: int) -> tuple[int, int]:
        """From which image on a piece adds apart, and how many rows further."""
        split = self.image[piece + 1]
        return split, self.image[-1] + piece * self.spare - split

    def clear(self, piece: int, rows: np.ndarray) -> None:
        """Set rows (images + apart, ...) to zero where a piece adds to them."""
        rows[self.image[piece] : self.image[piece + 1]] = 0.0
        rows[self.image[-1] + piece * self.spare :][: self.spare] = 0.0

    def fold(self, rows: np.ndarray) -> None:
        """Add what lies apart to the rows (images + apart, ...) where it belongs."""
        for piece in range(len(self) - 1):
            split, further = self.shift(piece)
            mine = rows[split : min(split + self.spare, self.image[-1])]
            mine += rows[split + further :][: len(mine)]

    def run(self, work: Callable[[int, int, int], None]) -> None:
        """Call work(piece, first, last) for the points of each piece."""
        if len(self) == 1:
            work(0, *self.point)
            return
        with ThreadPoolExecutor(self.threads) as pool:
            list(pool.map(work, range(len(self)), self.point, self.point[1:]))
