"""Everything an adjustment is asked for by an authority: precision, correlations, reliability.

Standard deviations of camera, poses and points, correlations of the camera, redundancy and sigma
naught by kind with their tests, what could have hidden (Baarda 1968), control points that are
wrong, and maps of the precision (James, Robson and Smith 2017).
"""

import numpy as np

from corridor.core.output import Table, fixed, short
from corridor.tools.certificate.forms import asprs, din18740
from corridor.tools.certificate.statement import MOST_LISTED, Statement, Subject

TITLE = "Certificate of computed figures, full"
# Correlations are shown of so many parameters; of more, the strong ones are listed by the report.
_MOST_PARAMETERS = 14
# Tables of the report that are taken over.
_REPORTED = ("Variance components", "Effects", "Reliability", "Distances", "Points",
             "Strong correlations")  # fmt: skip


def statement(subject: Subject) -> Statement:
    """The figures of `din18740` and `asprs`, with correlations and reliability."""
    adjusted = subject.adjustment
    proof, accuracy = din18740.statement(subject), asprs.statement(subject)
    others = [table for title, table in subject.reported.items() if title in _REPORTED]
    tables = [*proof.tables[:-1], _correlations(subject), *others, _control(subject)]
    points = subject.checked
    if len(points) and subject.tied_to_ground:
        tables.append(accuracy.tables[0])
    tables.append(proof.tables[-1])
    doubts = accuracy.doubts if len(points) else proof.doubts
    caption = (
        "Standard deviations of the points, exact: in the datum of the block, and among themselves."
    )
    maps = subject.picture("precision_maps", adjusted, caption)
    untested = [*accuracy.untested[:-1], proof.untested[0]]
    untested.append("Effects that the model does not have: `corridor diagnose` looks for them.")
    return Statement(
        proof.opening,
        doubts,
        [table for table in tables if table is not None],
        untested,
        {**proof.figures, **(accuracy.figures if len(points) else {})},
        [maps, *accuracy.pictures],
    )


def _correlations(subject: Subject) -> Table | None:
    """Correlation coefficients of the camera's parameters."""
    matrix = subject.adjustment.correlation_matrix
    names = [name for name in matrix.columns if str(name).startswith("camera.")]
    if not 1 < len(names) <= _MOST_PARAMETERS:
        return None
    values = matrix.loc[names, names].to_numpy(float)
    several = len({str(name).split(".")[1] for name in names}) > 1
    short = [str(name).removeprefix("camera.") for name in names]
    short = short if several else [name.rpartition(".")[2] for name in short]
    rows = tuple(
        (name, *(fixed(values[k, j], 2) if j <= k else "" for j in range(len(names))))
        for k, name in enumerate(short)
    )
    return Table("Correlations of the camera", ("", *short), rows, "l" + "r" * len(names))


def _control(subject: Subject) -> Table | None:
    """Reliability of each control point, its three coordinates side by side."""
    reliability = subject.adjustment.reliability
    table = reliability.control
    if not len(table):
        return None
    numbers = {
        name: table[name].to_numpy(float).reshape(-1, 3)
        for name in ("redundancy", "w", "least_error", "predicted")
    }
    hidden = reliability.external
    moved = np.nan_to_num(hidden["moved"].to_numpy(float)).reshape(-1, 3)
    most = moved.argmax(axis=1)
    at = hidden["at"].to_numpy(object).reshape(-1, 3)
    order = np.argsort(-np.abs(numbers["w"]).max(axis=1), kind="stable")[:MOST_LISTED]
    rows = tuple(
        (
            short(table["point"].iloc[3 * k], 16),
            *(fixed(x, 2) for x in numbers["redundancy"][k]),
            *(fixed(x, 1) for x in numbers["w"][k]),
            *(_mm(x) for x in numbers["least_error"][k]),
            *(_mm(x) for x in numbers["predicted"][k]),
            _mm(moved[k, most[k]]),
            short(at[k, most[k]], 12),
        )
        for k in np.sort(order)
    )
    notes = [
        "redundancy: share of an error that its residual shows; least error: found with 80 % where "
        "one good of a thousand is accused; predicted: given minus what all other measurements say "
        "of the point; moves: what the least error, if it is not found, moves most, and where; mm"
    ]
    if len(rows) < len(numbers["w"]):
        notes.append(f"the {len(rows)} of {len(numbers['w'])} with the largest w")
    header = (
        "control", "redundancy", "y", "z", "w x", "y", "z", "least error", "y", "z",
        "predicted", "y", "z", "moves", "at",
    )  # fmt: skip
    return Table("Reliability of control", header, rows, "l" + 13 * "r" + "l", tuple(notes))


def _mm(value: float) -> str:
    return "none" if np.isinf(value) else fixed(1e3 * value, 0 if abs(value) >= 0.1 else 1)
