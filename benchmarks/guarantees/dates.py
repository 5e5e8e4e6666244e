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

    yield (
        "Sigmas of one date are those of simulated adjustments (precision maps)",
        "the same flight with new noise again and again: scatter over stated sigma of tie points "
        "(x, y, z), of the surface, of a volume",
        _maps(known.get("maps")),
        f"`{RUN}`",
    )
    yield (
        "Distances of surfaces are those of M3C2",
        "the same clouds, core points and normals given to py4dgeo, where that is installed",
        _m3c2(known.get("m3c2")),
        f"`{RUN}`",
    )
    yield (
        "Two dates of 1,000 images and 20,000 core points are compared in 60 s and 3 GB beyond "
        "their adjustments",
        "the dike made longer, tie points matched across the dates and not; two threads",
        _speed(known.get("speed")),
        f"`{RUN}`",
    )


def _maps(found: dict | None) -> str:
    if not found:
        return "not run"
    ratios = [
        *found["scatter_over_sigma_xyz"],
        found["scatter_over_sigma_surface"],
        found["scatter_over_sigma_volume"],
    ]
    return (
        f"{', '.join(f'{ratio:.3f}' for ratio in ratios)}, standard error "
        f"{found['standard_error']:.3f}; {found['draws']:,} adjustments of "
        f"{found['seconds_simulated']:.0f} s in place of one of {found['seconds_exact']:.1f} s"
    )


def _m3c2(found: dict | None) -> str:
    if not found:
        return "not run"
    return (
        f"largest difference {found['largest_difference_m']:.0e} m of {found['core_points']} core "
        "points"
    )


def _speed(found: list | None) -> str:
    if not found:
        return "not run"
    told = [
        f"{one['seconds']:.0f} s ({one['processor_seconds']:.0f} s of processor time) and "
        f"{one['peak_gb_after']:.1f} GB for {one['core_points']:,} core points, "
        f"{'matched' if one['same_ties'] else 'others'}"
        for one in found
    ]
    return "; ".join(told)


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
