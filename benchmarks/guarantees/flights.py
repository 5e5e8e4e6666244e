"""Rows of the guarantees on what is said of a measured flight with a known effect put into it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

_COMMAND = (
    "`python -m benchmarks.diagnosis.real_noise FOLDER`, then `python -m "
    "benchmarks.diagnosis.real_rates FOLDER OUT --figures docs/guarantees.json`"
)
_SURVEY = "parts of a real survey (RTK, a mechanical shutter, tie points of another program)"
_ROWS = (
    (
        "Of a flight that lacks nothing nothing is named",
        f"{_SURVEY}, untouched",
        ("untouched blocks of which something is said",),
    ),
    (
        "What is missing at 10 sigma and more is named where the flight can tell it from all else",
        f"an effect put into {_SURVEY}; the flight can tell it where its geometry keeps it five "
        "sigmas from every other effect and from noise of the GNSS",
        (
            "of 10 sigma, which the flight can tell from all others: named",
            "of these with what the untouched part has and what was put in",
            "of these with the right value",
        ),
    ),
    (
        "Where it cannot, what is named is a set with the cause in it",
        "the same, of 10 sigma and more",
        ("of 10 sigma: in the set that is named",),
    ),
    (
        "Control points that are wrong by 6 stated sigmas and more are found, one or two",
        f"control of {_SURVEY} made wrong in height",
        ("control blunders named", "control blunders in the set that is named"),
    ),
    (
        "No value that does not happen, no remedy that makes check points worse",
        "all of these blocks",
        ("absurd values", "check points worse by a tenth, than in the untouched part too"),
    ),
)


def rows(made: Mapping[str, str] | None) -> Iterator[tuple[str, str, str, str]]:
    """What, how, figure, command."""
    for what, how, names in _ROWS:
        found = "not run" if made is None else "; ".join(f"{n}: {made[n]}" for n in names)
        yield what, how, found, _COMMAND
