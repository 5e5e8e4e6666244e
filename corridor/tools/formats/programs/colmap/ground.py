"""ground_points.csv beside a model: which of its points are ground points, and where they lie."""

import io
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core.block import ROLES, Block
from corridor.core.errors import InputError
from corridor.core.textfile import lines
from corridor.tools.formats.names import in_any_case

_FILE = "ground_points.csv"
_NEEDED = ("POINT3D_ID", "point", "x", "y", "z", "role")


def write_ground(block: Block, numbers: np.ndarray, names: pd.Index, folder: Path) -> None:
    """Write the file of the points of these numbers and names, if there are any."""
    if not len(names):
        return
    ground = block.ground.set_index("point").reindex(names).reset_index(drop=True)
    table = pd.concat([pd.DataFrame({"POINT3D_ID": numbers, "point": names}), ground], axis=1)
    text = table.to_csv(index=False, lineterminator="\n")
    (folder / _FILE).write_text(
        f"# Number of ground points: {len(table)}\n{text}", encoding="utf-8", newline="\n"
    )


def read_ground(folder: Path) -> pd.DataFrame | None:
    """What `write_ground` left beside a model; None where there is none.

    Raises InputError where it is damaged: without it ground points would become tie points.
    """
    path = in_any_case(folder / _FILE)
    if not path.is_file():
        return None
    head, _, text = "".join(f"{line.text}\n" for line in lines(path)).partition("\n")
    try:
        kinds = dict.fromkeys(("POINT3D_ID", "point", "role"), str)
        table = pd.read_csv(io.StringIO(text), dtype=kinds)
        numbers = [name for name in ("x", "y", "z", "sx", "sy", "sz") if name in table]
        table[numbers] = table[numbers].astype(float)
    except (ValueError, KeyError) as error:
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise _damaged(path, reason) from None
    missing = [name for name in _NEEDED if name not in table]
    if missing:
        raise _damaged(path, f"no column {missing[0]}")
    whole = head.startswith("#") and head.rpartition(" ")[2] == str(len(table)) and len(table)
    known = table[["POINT3D_ID", "point"]].notna().all(axis=None)
    finite = not np.isinf(table[["x", "y", "z"]].to_numpy()).any()
    roles = table["role"].isin(ROLES).all()
    if not (whole and known and finite and roles) or table["point"].duplicated().any():
        raise _damaged(path, "a bad cell")
    return table


def _damaged(path, reason):
    return InputError(
        f"{path.name} is damaged ({reason}); delete it (ground points are tie points then) or "
        "export the block again"
    )
