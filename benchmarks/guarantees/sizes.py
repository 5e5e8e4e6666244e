"""Rows of the guarantees on a diagnosis at every size, on flights nobody tuned to, and on nulls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

_FIGURES = "--figures docs/guarantees.json"


def rows(made: Callable) -> Iterator[tuple[str, str, str, str]]:
    """What, how, figure, command."""
    yield (
        "A diagnosis ends at every size, names nothing where nothing of the catalogue is missing, "
        "and says of a block what it says of its double",
        "dirty blocks by a generator of its own: lenses that are no polynomial, rows that shift, "
        "clusters of wrong matches, uneven overlap, positions lost, gaps, two cameras, control or "
        "none; beside each two copies in a row, or half of its points; two blocks of 12 images "
        "are a test",
        _ladder(made("ladder")),
        f"`python -m benchmarks.ladder -o OUT {_FIGURES}`",
    )
    yield (
        "Of blocks from which nothing is missing, `p_nothing` and the p of `halves` are below "
        "0.01 in one of a hundred",
        "simulated blocks, and real flights whose own residuals are resampled by runs of images; "
        "Kolmogorov-Smirnov against the uniform distribution",
        _nulls(made("nulls")),
        f"`python -m benchmarks.diagnosis.nulls -o OUT {_FIGURES}`",
    )
    yield (
        "A diagnosis is as right on a flight that no number was fitted to",
        "each flight in turn left out, with the numbers that do best on all others; flights join "
        "by being laid in the folder with `NAME.truth.json`",
        _left_out(made("left_out")),
        f"`python -m benchmarks.diagnosis.protocol FOLDER -o OUT {_FIGURES}`",
    )


def _ladder(found: Mapping | None) -> str:
    if not found:
        return "not run"
    wanted = ("crashes", "false names", "false names in doubles", "block and double agree")
    sizes = sorted(found, key=int)
    return "; ".join(
        f"{size} images, {found[size]['blocks']} blocks: "
        + ", ".join(f"{name} {found[size][name]}" for name in wanted if name in found[size])
        for size in sizes
    )


def _nulls(found: Mapping | None) -> str:
    if not found:
        return "not run"
    names = {"p": "`p_nothing`", "halves": "halves"}
    out = []
    for key, one in found.items():
        kind, _, what = key.partition(", ")
        if one["count"]:
            out.append(
                f"{names[what]}, {one['count']} {kind}: p = {one['ks']:.2f}, below 0.01: "
                f"{one['below_1']}"
            )
    return "; ".join(out)


def _left_out(found: Mapping | None) -> str:
    if not found:
        return "not run"
    return "; ".join(
        f"{flight}: {one['blocks']} blocks, hidden effects in the set that is named "
        f"{one['hidden, in the set that is named']}, wrong names {one['wrong names']}, untouched "
        f"of which something is said {one['untouched, something said']}"
        for flight, one in found.items()
    )


def matters(found: Mapping | None) -> str:
    """A section on the numbers of a diagnosis that change an answer when halved or doubled."""
    if not found:
        return ""
    changing = {name: one for name, one in found.items() if one["changed"]}
    numbers = {name.partition(" x ")[0] for name in found}
    still = sorted(numbers - {name.partition(" x ")[0] for name in changing})
    lines = [
        "",
        "## Which numbers of a diagnosis matter",
        "",
        f"Each of {len(numbers)} numbers of `corridor.diagnosis.settings.Settings` halved and "
        "doubled, one at a time. Score: one for a right answer, less one for what is false, the "
        "mean over the blocks, less that of the usual numbers. By `python -m "
        f"benchmarks.diagnosis.protocol FOLDER -o OUT --sensitivity all {_FIGURES}`.",
        "",
        "| number | answers that change | score |",
        "|---|---|---|",
    ]
    order = sorted(changing, key=lambda name: (-changing[name]["changed"], name))
    lines += [
        f"| `{name}` | {changing[name]['changed']} of {changing[name]['blocks']} | "
        f"{changing[name]['score']:+.2f} |"
        for name in order
    ]
    if still:
        lines += ["", f"No answer changes by: {', '.join(f'`{name}`' for name in still)}."]
    return "\n".join(lines) + "\n"
