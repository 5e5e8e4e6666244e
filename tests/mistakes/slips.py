"""Slips of the hand: what is wrong in the files of a block, made on purpose.

Each function returns an edit: a function of the folder of a block.
"""

import numpy as np
import pandas as pd

WIDTH, HEIGHT, FOCAL = 5120, 3840, 5489.0
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
QW_LAST = {"qw": "qx", "qx": "qy", "qy": "qz", "qz": "qw"}


def table(name, change):
    """A table changed: `change` returns another one, or changes it in place."""

    def edit(folder):
        frame = pd.read_csv(folder / f"{name}.csv")
        changed = change(frame)
        (frame if changed is None else changed).to_csv(folder / f"{name}.csv", index=False)

    return edit


def plus(name, **shifts):
    """Columns of a table shifted."""
    return table(name, lambda frame: frame.assign(**{k: frame[k] + v for k, v in shifts.items()}))


def times(name, factor, *columns):
    """Columns of a table multiplied."""
    return table(name, lambda frame: frame.assign(**{k: frame[k] * factor for k in columns}))


def cell(name, row, column, factor):
    """One cell multiplied."""

    def change(frame):
        frame.loc[row, column] *= factor

    return table(name, change)


def exchanged(name, one="x", other="y"):
    """Two columns exchanged."""
    return table(name, lambda frame: frame.rename(columns={one: other, other: one}))


def degrees(name):
    """Plan positions in degrees, about 51 N 7 E."""
    return table(
        name, lambda frame: frame.assign(x=7 + frame["x"] / 70_000, y=51 + frame["y"] / 111_000)
    )


def toml(old, new):
    """A text in block.toml replaced."""

    def edit(folder):
        text = (folder / "block.toml").read_text()
        assert old in text
        (folder / "block.toml").write_text(text.replace(old, new, 1))

    return edit


def more(text, first=False):
    """Text at the end of block.toml, in the table of the camera, or at its head."""

    def edit(folder):
        path = folder / "block.toml"
        parts = (text, path.read_text()) if first else (path.read_text(), text)
        path.write_text("\n".join(parts))

    return edit


def both(*edits):
    def edit(folder):
        for one in edits:
            one(folder)

    return edit


def images(change):
    """Image coordinates of ties and marks changed alike."""
    return both(table("tie_points", change), table("marks", change))


def changed(name, **columns):
    """Columns of a table replaced: by values, or by what a function makes of the old ones."""
    return table(
        name,
        lambda f: f.assign(**{k: v(f[k]) if callable(v) else v for k, v in columns.items()}),
    )


def two_points(one, other):
    """Two ground points exchanged: of those with these roles, the two that lie farthest apart."""

    def change(frame):
        roles = frame["role"].to_numpy()
        xyz = frame[["x", "y", "z"]].to_numpy()
        apart = np.linalg.norm(xyz[:, None] - xyz, axis=2)
        apart[(roles[:, None] != one) | (roles != other)] = -1.0
        pair = list(np.unravel_index(apart.argmax(), apart.shape))
        frame.loc[frame.index[pair], ["x", "y", "z"]] = xyz[pair[::-1]]

    return table("ground", change)


def reversed_track(folder):
    """A track whose times were written from the last to the first."""
    time = np.linspace(0.0, 60.0, 30)[::-1]
    pd.DataFrame({"time_s": time, "x": time, "y": 0.0, "z": 100.0}).to_csv(
        folder / "track.csv", index=False
    )
