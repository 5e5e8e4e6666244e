"""Draws of a benchmark: each kept when it is done, and what all of them say, with its interval."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from corridor.core.output import whole_file


def kept(folder: Path, numbers: Iterable[int], draw: Callable[[int], dict]) -> list[dict]:
    """What `draw` gives for each number, arrays by name; kept in folder/NUMBER.npz.

    An interrupted run goes on where it stopped. A folder belongs to one version of what is drawn.
    """
    out = []
    for number in numbers:
        path = folder / f"{number}.npz"
        if not path.exists():
            found = draw(number)
            with whole_file(path) as part, part.open("wb") as file:
                np.savez(file, **found)
        with np.load(path) as stored:
            out.append({name: stored[name] for name in stored.files})
    return out


def ratio(squares: np.ndarray) -> dict:
    """Root of the mean square of errors over their sigma, and its interval (95 %).

    squares (n,): of each draw; what is common to all numbers of a draw counts once.
    """
    found = float(np.sqrt(squares.mean()))
    off = 1.96 * squares.std(ddof=1) / np.sqrt(len(squares)) / (2 * found)
    return {"ratio": found, "low": float(found - off), "high": float(found + off)}
