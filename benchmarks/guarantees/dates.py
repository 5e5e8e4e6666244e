"""What is guaranteed of a comparison of two dates: rows of the page, from `benchmarks.change`."""

from __future__ import annotations

from benchmarks.diagnosis.rates import Rate

RUN = "python -m benchmarks.change -o FOLDER --figures docs/guarantees.json"


def rows(found: dict | None):
    """What, how, figure, command: rows of the page of guarantees."""
    known = found or {}
    yield (
        "Errors are as large as stated: `change`, displacements of points, distances of the "
        "surface, a volume",
        "two flights over a dike at rest, new noise each draw",
        _rates(known.get("rates")),
        f"`{RUN}`",
    )
    yield (
        "A change of the surface at its level of detection is seen in half of the cases, at twice "
        "that in 97 %",
        "the same draws, raised by as much",
        _seen(known.get("rates")),
        f"`{RUN}`",
    )
    yield (
        "Ground at rest is said to have moved in at most 1 % of pairs of flights, in at most 2 % "
        "where the camera changed",
        "at the second date a rolling shutter, another focal length, a GNSS bias, another lever "
        "arm, or heat",
        _false(known.get("verdicts")),
        f"`{RUN}`",
    )


def _rates(found: dict | None) -> str:
    if not found:
        return "not run"
    told = [
        f"{kind} {one['ratio']:.3f} ({one['low']:.3f} to {one['high']:.3f}, 95 %)"
        for kind, one in found["scatter_over_sigma"].items()
    ]
    return f"error over sigma: {'; '.join(told)}; {found['draws']} draws"


def _seen(found: dict | None) -> str:
    if not found:
        return "not run"
    pairs = zip(
        found["seen_at_level_of_detection_and_at_twice"], found["half_width_of_the_interval"],
        strict=True,
    )  # fmt: skip
    once, twice = (f"{100 * share:.1f} \u00b1 {100 * off:.1f} %" for share, off in pairs)
    return f"{once} and {twice} (95 %), {found['draws']} draws"


def _false(found: dict | None) -> str:
    if not found:
        return "not run"
    rest, camera = (
        Rate(found[key]["hits"], found[key]["count"])
        for key in ("moved_at_rest", "moved_by_camera_alone")
    )
    return f"at rest {rest}; with the camera alone {camera}"
