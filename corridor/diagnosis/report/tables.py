"""The tables of the page, in words and digits; a table with nothing to say has no rows."""

from __future__ import annotations

import platform
from importlib.metadata import version

import numpy as np
import pandas as pd

from corridor.core import __version__
from corridor.core.output import DASH, scaled
from corridor.diagnosis.bootstrap.comparison import Comparison
from corridor.diagnosis.findings.diagnosed import Diagnosed
from corridor.diagnosis.findings.findings import Estimate
from corridor.diagnosis.report.wording import (
    cannot_separate,
    effects_by_slug,
    listed,
    placed,
    to_add,
    two_digits,
    upper,
    value_and_sigma,
)
from corridor.diagnosis.verification.held_out import closure

# Parameters of one effect in the table; all of them are in diagnosis.json.
MOST = 8
# Statistics in the table of those that leave their band.
MOST_LEAVING = 15
_LIBRARIES = ("numpy", "scipy", "numba", "pandas", "matplotlib")
CHECK_RMS = "check-point error, RMS"
CLASSES = {
    "named": "named",
    "ambiguous": "cannot be told apart",
    "suspected": "suspected",
    "unknown": "outside the catalogue",
}


def found(d: Diagnosed) -> pd.DataFrame:
    """Effects that were found, a row a parameter."""
    known, rows = effects_by_slug(), []
    for one in d.findings.effects:
        name = upper(placed(known[one.slug].called, one.where))
        alike = listed([known[slug].called for slug in one.alternatives], "or") or DASH
        for k, p in enumerate(one.parameters[:MOST]):
            value, sigma, unit = value_and_sigma(p)
            if one.untold:
                value, sigma = "cannot be told", DASH
            first = k == 0
            rows.append(
                (
                    name if first else "", one.slug if first else "",
                    CLASSES[one.kind] if first else "",
                    p["name"] + (" (RMS of the images)" if "statistic" in p else ""),
                    value, f"\u00b1 {sigma}{_formal(p)}", unit,
                    f"{one.log_evidence:,.1f}" if first else "", alike if first else "",
                )
            )  # fmt: skip
        more = len(one.parameters) - MOST
        if more > 0:
            rows.append(("", "", "", f"{more} more in diagnosis.json", "", "", "", "", ""))
    columns = [
        "effect", "slug", "class", "parameter", "value", "sigma", "unit", "log evidence",
        "cannot be told apart from",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def _formal(parameter: dict) -> str:
    """The formal standard deviation where that of the strips has taken its place."""
    if "sigma_formal" not in parameter:
        return ""
    return (
        f" by strips, {value_and_sigma(parameter | {'sigma': parameter['sigma_formal']})[1]} formal"
    )


def separating(d: Diagnosed) -> pd.DataFrame:
    """What would tell apart what this flight cannot."""
    known = effects_by_slug()
    rows = [
        (
            upper(listed([known[s].called for s in (one.slug, *one.alternatives)], "or")),
            one.separate, _chosen(d, one),
        )
        for one in d.findings.effects
        if one.alternatives
    ]  # fmt: skip
    columns = ["look alike here", "told apart by", "adjusted with"]
    return pd.DataFrame(rows, columns=columns).drop_duplicates()


def _chosen(d: Diagnosed, one: Estimate) -> str:
    """Which of the look-alikes the block was adjusted with, and why."""
    key = next((key for key in [one.key, *one.rivals] if key in d.used), None)
    if key is None:
        return DASH
    name = effects_by_slug()[key.partition(".")[0]].called
    if key == one.key:
        return f"{name}; no data speak for another"
    return f"{name}: check points err {d.rivals[key]['check']:.2f} times as much with it"


def unknown(d: Diagnosed) -> pd.DataFrame:
    """What lies outside the catalogue: as what it shows, where, and whether a shape helps."""
    known = effects_by_slug()
    rows = [
        (
            upper(known[one.group].called), CLASSES[one.kind],
            one.where, f"{one.log_evidence:,.1f}",
            listed(
                known[s].called for s in (*one.alike, *one.parts)
            ) or DASH,
            "yes" if one.correction == "helps" else "no, not applied",
        )
        for one in d.findings.unknown
    ]  # fmt: skip
    columns = [
        "it shows as", "class", "where", "log evidence", "overlaps with",
        "helps held-out data",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def gap(d: Diagnosed, before: Comparison | None, after: Comparison | None) -> pd.DataFrame:
    """What data that the fit has not used say before and after, and the floor of noise."""
    added = bool(d.findings.effects or any(one.correction != "none" for one in d.findings.unknown))
    floor = _floor(after if added else before)
    rows = []
    for key, name, factor, unit in (
        ("tie_px", "image points held out, RMS an axis", 1.0, "px"),
        ("check_m", "check points, 3D RMS", 1e3, "mm"),
        ("gnss_m", "GNSS residuals, 3D RMS", 1e3, "mm"),
    ):
        mine = d.gap[key]
        if not mine or mine["before"] is None:
            continue
        least = floor if key == "check_m" else None
        digits = 3 if unit == "px" else 1
        closed = None
        if added and least is not None:
            closed = closure(mine["before"], mine["after"], least)
        rows.append(
            (
                name, unit, _number(factor * mine["before"], digits),
                _number(factor * mine["after"], digits) if added else DASH,
                DASH if least is None else _number(factor * least, digits),
                # Beside the noise alone a share of hardly anything says nothing.
                DASH if closed is None or mine["before"] < 1.2 * least else _share(closed),
            )
        )  # fmt: skip
    columns = ["", "unit", "before", "after", "noise alone", "closed"]
    table = pd.DataFrame(rows, columns=columns)
    if not added:
        return table.drop(columns=["after", "closed"]).rename(columns={"before": "measured"})
    return table


def _floor(case: Comparison | None) -> float | None:
    """3D RMS of check points (m) that the model and its noise alone produce: the counterparts'."""
    if case is None:
        return None
    mine = [one for one in case.statistics if one.statistic.name == CHECK_RMS]
    return float(np.sqrt((mine[0].middle ** 2).sum())) if mine else None


def leaving(before: Comparison | None, after: Comparison | None) -> pd.DataFrame:
    """Statistics that leave their band before, farthest first, and what becomes of them."""
    columns = ["curve", "farthest (standard deviations)", "band ends at", "where", "after"]
    if before is None:
        return pd.DataFrame(columns=columns)
    table = before.table[before.table["leaves"]].sort_values("excess", ascending=False)
    then = {} if after is None else {one.statistic.name: one for one in after.statistics}
    rows = []
    for row in table.head(MOST_LEAVING).itertuples(index=False):
        one = then.get(row.statistic)
        if one is None:
            told = DASH
        else:
            worst = one.z[int(np.argmax(np.abs(one.z)))]
            told = f"{worst:+.1f}, {'still outside' if one.leaves else 'inside'}"
        rows.append((row.statistic, f"{row.farthest:+.1f}", f"{row.limit:.1f}", row.where, told))
    if len(table) > MOST_LEAVING:
        rows.append((f"{len(table) - MOST_LEAVING} more", "", "", "", ""))
    made = pd.DataFrame(rows, columns=columns)
    return made if then else made.drop(columns="after")


def evidence(d: Diagnosed) -> pd.DataFrame:
    """Log evidence of every candidate: name, generic, found, alone, beside (what was found).

    Of single control points the strongest one.
    """
    last, known = d.course.last, effects_by_slug()
    alone = last.evidence.given({})
    beside = last.evidence.given(last.found.chosen)
    best: dict[str, tuple] = {}
    for n, group in enumerate(last.evidence.groups):
        there = n in last.found.chosen
        with_others = last.found.evidence[n] if there else beside[n].evidence
        where = {} if group.single is None else {group.effect.group: group.single}
        row = (
            upper(placed(known[group.slug].called, where)), group.generic, there,
            float(alone[n].evidence), float(with_others),
        )  # fmt: skip
        if group.slug not in best or (there, row[3]) > (best[group.slug][2], best[group.slug][3]):
            best[group.slug] = row
    frame = pd.DataFrame(
        list(best.values()), columns=["name", "generic", "found", "alone", "beside"]
    )
    return frame.sort_values("alone", ascending=False, kind="stable").reset_index(drop=True)


def not_separated(d: Diagnosed) -> pd.DataFrame:
    """Values that hold only as long as another effect is not there."""
    return pd.DataFrame(
        {"values that another effect would change": cannot_separate(d.block, d.not_separated)}
    )


def limits(d: Diagnosed) -> pd.DataFrame:
    """The smallest effect of each kind that would have been seen, beside what is usual."""
    known, rows = effects_by_slug(d.block), []
    for slug in sorted(d.detection_limits):
        mine, effect = d.detection_limits[slug], known[slug]
        scales = {p.name: p for p in effect.parameters(d.block)}
        if len(mine) > MOST:
            values = [v for v in mine.values() if v]
            unit = next(iter(scales.values())).unit
            factor, text = scaled(unit, *values)
            smallest = (
                f"{two_digits(factor * min(values))} to {two_digits(factor * max(values))}"
                if values
                else "not visible"
            )
            usual = two_digits(factor * next(iter(scales.values())).scale)
            rows.append((upper(effect.called), f"{len(mine)} parameters", smallest, usual, text))
            continue
        for k, (name, limit) in enumerate(mine.items()):
            p = scales[name]
            factor, text = scaled(p.unit, limit, p.scale, name=name)
            rows.append(
                (
                    upper(effect.called) if k == 0 else "", name,
                    "not visible" if limit is None else two_digits(factor * limit),
                    two_digits(factor * p.scale), text,
                )
            )  # fmt: skip
    columns = ["effect", "parameter", "smallest seen", "usual size", "unit"]
    return pd.DataFrame(rows, columns=columns)


def by_remedy(d: Diagnosed) -> dict[str, list[str]]:
    """What to hand in -> what could be tested then."""
    known, out = effects_by_slug(), {}
    for one in d.untestable:
        effect = known[one["slug"]]
        every = ", ".join(effect.missing(d.block))
        out.setdefault(to_add(every or one["missing"]), []).append(effect.called)
    return out


def untestable(d: Diagnosed, before: Comparison | None) -> pd.DataFrame:
    """What could not be tested or compared, by what to hand in: what helps most comes first."""
    groups = by_remedy(d)
    for what, column in () if before is None else before.missing.items():
        groups.setdefault(to_add(column), []).append(what)
    if d.gap["check_m"] is None:
        remedy = "check points (role check in ground.csv), measured in marks.csv"
        groups.setdefault(remedy, []).append("errors on the ground")
    rows = [
        (remedy, "; ".join(names))
        for remedy, names in sorted(groups.items(), key=lambda item: -len(item[1]))
    ]
    return pd.DataFrame(rows, columns=["to add", "then tested"])


def lens(d: Diagnosed) -> pd.DataFrame:
    """What the lens has beside its polynomials, and what that does to the ground."""
    columns = [
        "RMS (px)", "most (px)", "moves the ground (mm)", "in its sigmas", "held-out ties",
        "worth a correction",
    ]  # fmt: skip
    one = d.lens
    if one is None:
        return pd.DataFrame(columns=columns)
    row = (
        f"{one['rms_px']:.2f}", f"{one['most_px']:.2f}", f"{1e3 * one['ground_m']:.0f}",
        f"{one['ground_sigmas']:.1f}", f"{100 * (one['held_out_ratio'] - 1):+.1f} %",
        "yes" if one["costs"] else "no, as lenses are",
    )  # fmt: skip
    return pd.DataFrame([row], columns=columns)


def without_catalogue(d: Diagnosed) -> pd.DataFrame:
    """The two answers that need no catalogue."""
    halves, told = d.halves, "nothing was compared"
    if halves.p is not None:
        far = halves.farthest
        value, sigma, unit = value_and_sigma(far)
        told = (
            f"chi square {halves.chi_square:.1f} of {halves.freedom}, phi {halves.phi:.2f}; most "
            f"of all {far['name']}: {value} +- {sigma} {unit}".rstrip()
        )
    rows = [
        ("all tests together, if nothing is missing", f"{d.p_nothing:.3g}", ""),
        (
            f"odd against even {halves.by or 'images'}",
            "" if halves.p is None else f"{halves.p:.3g}",
            halves.reason or told,
        ),
    ]
    return pd.DataFrame(rows, columns=["question", "p", "detail"])


def variance(d: Diagnosed) -> pd.DataFrame:
    """Quantities with which the size of the image noise changes, and clusters of wrong matches."""
    rows = [
        (alarm["quantity"], f"{alarm['ratio']:.2f}", f"{alarm['z']:+.1f}", alarm["where"])
        for alarm in d.alarms
    ]
    columns = [
        "what is uneven", "largest over smallest, or usual", "in standard deviations", "where",
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def rounds(d: Diagnosed) -> pd.DataFrame:
    """What each round of the search began with and found."""
    rows = []
    for n, one in enumerate(d.course.rounds, start=1):
        gained = ", ".join(f"{key} {value:,.1f}" for key, value in one.log["found"].items())
        rows.append(
            (
                str(n), ", ".join(one.log["model"]) or "nothing more", gained or "nothing",
                f"{one.log['sigma_px']:.3f}",
            )
        )  # fmt: skip
    columns = ["round", "added to the model", "found, log evidence", "image noise (px)"]
    return pd.DataFrame(rows, columns=columns)


def believed(d: Diagnosed) -> pd.DataFrame:
    """The assumed model, as adjusted."""
    rows, system = [], d.before.system
    for name, free in system.free.items():
        rows.append((f"camera {name}", f"free: {', '.join(free)}" if len(free) else "held"))
    rows.append(("effects", ", ".join(e.slug for e in d.believed.effects) or "none"))
    positions = len(system.gnss.names)
    if positions:
        arms = "one free lever arm a flight" if system.arms_free else "lever arm as stated"
        rows.append(("GNSS", f"{positions:,} antenna positions, {arms}"))
    else:
        rows.append(("GNSS", "none"))
    for role in ("control", "check"):
        names = list(system.block.ground["point"].to_numpy(object)[system.roles == role])
        told = f"{len(names)}: {', '.join(names[:12])}" + (" ..." if len(names) > 12 else "")
        rows.append((f"{role} points", told if names else "none"))
    rows.append(("tie points", f"{len(system.block.tie_points):,} observations"))
    for name, (value, sigma) in d.believed.priors.items():
        rows.append((f"prior of {name}", f"{value:g} \u00b1 {sigma:g}"))
    rows.append(("sigma naught", f"{d.before.sigma0:.3f}"))
    return pd.DataFrame(rows, columns=["model", "as adjusted"])


def _number(value: float, digits: int) -> str:
    return f"{value:,.{digits}f}"


def _share(closed: float) -> str:
    """A share in per cent; more than all of it is noise."""
    return "all" if closed >= 0.995 else f"{100 * closed:.0f} %"


def versions(d: Diagnosed, before: Comparison | None) -> pd.DataFrame:
    """What has to be the same for the same page."""
    rows = [
        ("level of a false name", f"{100 * d.level:g} %"),
        ("seed", f"{d.seed}"),
        ("counterparts", f"{before.count if before else 0}"),
        ("Python", platform.python_version()),
        ("corridor", __version__),
        *((name, version(name)) for name in _LIBRARIES),
    ]
    return pd.DataFrame(rows, columns=["what", "value"])
