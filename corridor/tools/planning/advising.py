"""What a table of expected accuracies says, in sentences."""

from collections.abc import Sequence

import pandas as pd

from corridor.core.output import millimetres

_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
# From this share on a bias of the GNSS is on the ground as a whole, up to this one it is gone.
_WHOLE, _GONE = 0.9, 0.2


def advice(table: pd.DataFrame, goals: Sequence[float] = (0.01, 0.03)) -> str:
    """The cheapest way to each accuracy, and what it rests on.

    table: of `sweep`. goals: 3D RMS of check points, metres. Cheapest: the fewest flights, then
    the fewest control points.
    """
    solid = table[table["open"] == ""]
    if not len(solid):
        return f"None of these flight sets can be adjusted: {table['open'].iloc[0]}."
    reached: dict[object, list[str]] = {}
    missed = []
    for goal in sorted(goals):
        row = _first_within(solid, goal)
        if row is None:
            missed.append(millimetres(goal))
        else:
            reached.setdefault(row.name, []).append(millimetres(goal))
    said = []
    if missed:
        row = solid.loc[solid["d3"].idxmin()]
        nearest = _apart(row["d3"], missed)
        said.append(
            f"None of these reaches {' or '.join(missed)}; the nearest is {_what(row, solid)}: "
            f"{nearest}"
        )
    for index, names in reached.items():
        row = solid.loc[index]
        said.append(
            f"For {' and '.join(names)}: {_what(row, solid)}: {millimetres(row['d3'])}"
            f"{_gnss(row, solid)}"
        )
    return ". ".join(said) + "."


def _apart(metres: float, others: Sequence[str]) -> str:
    """A length with as many digits as make it another than those that it misses."""
    told, digits = millimetres(metres), 1
    while told in others and digits < 6:
        more = f"{1e3 * metres:.{digits}f}"
        told = f"{more} mm" if float(more) != round(float(more)) else told
        digits += 1
    return told


def cheapest(table: pd.DataFrame, goals: Sequence[float]) -> pd.Series | None:
    """The row of the strictest goal that is reached, else the nearest; None where none is solid."""
    solid = table[table["open"] == ""]
    if not len(solid):
        return None
    rows = (_first_within(solid, goal) for goal in sorted(goals))
    return next((row for row in rows if row is not None), solid.loc[solid["d3"].idxmin()])


def _first_within(solid: pd.DataFrame, goal: float) -> pd.Series | None:
    """The row with fewest flights, then fewest control points, that reaches a goal."""
    enough = solid[solid["d3"] <= goal]
    if not len(enough):
        return None
    flights = enough["nadir"] + enough["oblique"]
    return enough.loc[
        enough.assign(_flights=flights).sort_values(["_flights", "control", "d3"]).index[0]
    ]


def _what(row: pd.Series, table: pd.DataFrame) -> str:
    """ "one nadir and one oblique flight and one control point"."""
    parts = [f"{_number(row[view])} {view}" for view in ("nadir", "oblique") if row[view]]
    many = row["oblique"] > 1 or (row["oblique"] == 0 and row["nadir"] > 1)
    what = f"{' and '.join(parts)} flight{'s' * bool(many)}"
    alike = table[(table["nadir"] == row["nadir"]) & (table["oblique"] == row["oblique"])]
    if alike["flights"].nunique() > 1:
        what += f" ({row['flights']})"
    count = int(row["control"])
    return f"{what} and {_number(count)} control point{'s' * (count != 1)}"


def _gnss(row: pd.Series, table: pd.DataFrame) -> str:
    """How far a constant error of the GNSS reaches the ground, with this control and without."""
    rest = []
    plan = max(row["transfer_x"], row["transfer_y"])
    if row["control"] == 0:
        if row["transfer_z"] > _WHOLE:
            return "; but it is only as good as the GNSS, whose constant errors nothing would show"
        return ""
    without = table[(table["flights"] == row["flights"]) & (table["control"] == 0)]
    if len(without) and without["transfer_z"].iloc[0] > _WHOLE and row["transfer_z"] < _GONE:
        points = "point" if row["control"] == 1 else "points"
        rest.append(f"without the control {points} the height is only as good as the GNSS")
    if plan > 0.5:
        rest.append(f"horizontally {100 * plan:.0f} % of its constant error remains")
    return "".join(f"; {text}" for text in rest)


def _number(count: float) -> str:
    count = int(count)
    return _WORDS[count] if count < len(_WORDS) else str(count)
