"""The figures of a benchmark as text, 99 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from benchmarks.diagnosis.promises import Promise, promises
from benchmarks.diagnosis.rates import Rate

_HELD = {True: "holds", False: "NOT", None: "-"}
_NAMES = {
    "diagnosis": "corridor diagnose", "correlation": "residual correlation",
    "bic": "expert, by BIC", "t_test": "expert, by t-test",
    "check_points": "expert, by check points",
}  # fmt: skip
_KEY = """\
ratio: sqrt(theta' M theta), how strongly the truth shows after poses, points and camera.
Ratios of 6 and more: separable, neither another candidate nor slow noise of the GNSS within five
sigmas of the truth. Look-alikes: another candidate within three log units; of ratio 8 and more.
Check points: where they are more than twice as far off as the twin's. Told what is hidden: the
believed model with the true effect, adjusted; what that leaves, no diagnosis can close.
Intervals: 95 % (Wilson).
score: 1 for a right name, 1/2 for a set that holds it, -1 for a wrong name, their mean."""


def as_text(summary: Mapping) -> str:
    """Promises, rates by signal-to-noise ratio, and the methods beside each other."""
    blocks = ", ".join(f"{count} {kind}" for kind, count in summary["blocks"].items() if count)
    lines = [f"Blocks: {blocks or 'none'}.", ""]
    lines.append(f"{'':46}{'wanted':>17}{'found':>9}{'95 %':>15}{'blocks':>7}")
    lines += [_promise(one) for one in promises(summary)]
    lines += ["", "One effect, separable, by signal-to-noise ratio"]
    lines.append(f"  {'ratio':<12}{'blocks':>7}{'detected':>23}{'named':>23}{'inside':>23}")
    for one in summary["by_ratio"]:
        if one["detected"]["count"]:
            to = "more" if one["to"] is None else f"{one['to']:g}"
            cells = "".join(f"{_short(one[k]):>23}" for k in ("detected", "named", "inside"))
            lines.append(f"  {one['from']:g} to {to:<6}{one['detected']['count']:>9}{cells}")
    for key, title in (
        ("methods", "One effect, all blocks: methods at equal false-alarm rate"),
        ("methods_confounders", "Of these, where another effect does three quarters of the same"),
    ):
        lines += ["", *_methods(summary[key], title)]
    if summary["failed"]:
        lines += ["", "Failed:"]
        for name, why in summary["failed"].items():
            lines += textwrap.wrap(
                f"{name}: {why}", 97, initial_indent="  ", subsequent_indent="    "
            )
    seconds = summary["seconds"]
    if seconds["median"] is not None:
        lines += [
            "", f"Seconds a diagnosis: median {seconds['median']:.1f}, "
            f"largest {seconds['largest']:.1f}.",
        ]  # fmt: skip
    return "\n".join([*lines, "", _KEY])


def _promise(one: Promise) -> str:
    if one.found is None:
        return f"{one.name:<46}{one.wanted:>17}{'-':>9}{'':>15}{one.count:>7}"
    share = one.low is not None
    found = f"{100 * one.found:.1f} %" if share else f"{one.found:.2f}"
    interval = f"{100 * one.low:.0f} to {100 * one.high:.0f}" if share else ""
    return (
        f"{one.name:<46}{one.wanted:>17}{found:>9}{interval:>15}{one.count:>7}  {_HELD[one.holds]}"
    )


def _short(rate: Mapping) -> str:
    one = Rate(rate["hits"], rate["count"])
    low, high = one.interval
    return f"{100 * one.share:.1f} % ({100 * low:.0f} to {100 * high:.0f})"


def _methods(found: Mapping, title: str) -> list[str]:
    heads = (
        ("false alarms", "false_alarms"), ("detected", "detected"), ("named", "named"),
        ("wrong name", "wrong"), ("its set", "alike"),
    )  # fmt: skip
    known = {k: v for k, v in found.items() if v["detected"]["count"]}
    if not known:
        return []
    count = next(iter(known.values()))["detected"]["count"]
    lines = [f"{title} ({count} blocks)"]
    lines.append(f"  {'':<24}" + "".join(f"{head:>13}" for head, _ in heads) + f"{'score':>8}")
    for name, one in known.items():
        cells = "".join(f"{_cell(one[key]):>13}" for _, key in heads)
        lines.append(f"  {_NAMES[name]:<24}{cells}{one['score']:>8.2f}")
    return lines


def _cell(rate: Mapping) -> str:
    if not rate["count"]:
        return "-"
    low, high = Rate(rate["hits"], rate["count"]).interval
    return f"{100 * rate['share']:.0f} ({100 * low:.0f}-{100 * high:.0f})"
