"""Does what was found help where the fit has not looked?

Some tie observations are given no weight, one of a point of four rays or more, in all fits; the
check points never have any. Of what the fit cannot tell apart these data choose, a shape stays
only if they are predicted better with it, and no effect stays that does harm to check points.
GNSS residuals are those of the fits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.adjustment import Adjustment
from corridor.diagnosis.all_ground import AllGround, contradicted
from corridor.diagnosis.control import listed_points
from corridor.diagnosis.cost import Cost, tie_gap
from corridor.diagnosis.findings import Estimate, Findings, Unknown
from corridor.diagnosis.hold_out import hold_out
from corridor.diagnosis.location import locate
from corridor.diagnosis.prediction import Prediction
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.rounds import Course, members
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.verdict import in_place_of, other_control, shapes
from corridor.errors import AdjustmentFailed, InputError


class Verification:
    """Fits with and without what was found, of which tie observations were held out.

    findings, used: what is left of what was found, and the keys of the model to go on with. gap:
    RMS of held-out ties before and after, px, None where nothing could be held out. rivals: error
    with effects that cannot be told apart from those found, over the error with those found, of
    `check` points and `tie` points. notes: a sentence on each choice.
    """

    def __init__(self, believed: ReferenceModel, course: Course, found: Findings, seed: int):
        self.findings, self.used = found, list(course.last.keys)
        self.gap: dict[str, float | None] = {"before": None, "after": None}
        self.rivals: dict[str, dict[str, float]] = {}
        self.notes: list[str] = []
        self.lens: dict | None = None
        for key in [key for key in self.used if key in found.unproved]:
            self.used.remove(key)
            self.notes.append(
                f"{key} explains what was measured, but strips are predicted no better with what "
                "the other strips say of it: it is not taken for sure, and not added."
            )
        self._believed, self._last = believed, course.last
        self._effects = {effect.slug: effect for effect in course.candidates.effects}
        self._fitted: dict[frozenset[str], Adjustment] = {}
        few = len(believed.block.tie_points) <= SETTINGS.fewest_ties
        self._block, self._rows = (
            (believed.block, np.zeros(0, dtype=np.int64))
            if few
            else hold_out(believed.block, np.random.default_rng(seed))
        )
        said = "Held-out observations could not be compared"
        self._first = self._fit([], said)
        self._now = self._fit(self.used, said) if self.used and self._first else self._first
        if self._now is None:
            return
        self._go_on(self.used, self._now)
        self._choose_control()
        self._ask_all_ground()
        self._prove_images()
        self._drop_idle()
        self.lens = self._ask_lens()
        if not few:
            self._keep_shapes()
            self._choose_effects()
            self._choose_shapes()
        self._drop_harmful()

    def _fit(self, keys: list[str], said: str) -> Adjustment | None:
        which = frozenset(keys)
        if which in self._fitted:
            return self._fitted[which]
        try:
            fit = self._believed.adjust(members(self._effects, keys), block=self._block)
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"{said}: {failed}")
            return None
        # Several questions end at the same model; of large blocks each weighs gigabytes.
        if len(self._block.images) <= SETTINGS.large_block:
            self._fitted[which] = fit
        return fit

    def _fits(self, others: Iterable[str], instead: Callable[[str], list[str]]) -> dict:
        tried = {key: self._fit(instead(key), f"The fit with {key} failed") for key in others}
        return {key: fit for key, fit in tried.items() if fit is not None}

    def _go_on(self, keys: list[str], fit: Adjustment) -> None:
        self.used, self._now = keys, fit
        self.gap = tie_gap(self._first, fit, self._rows)

    def _ask_lens(self) -> dict | None:
        """What the lens is beside its polynomials and does to the ground, None where it is nothing.

        It is told as something outside the catalogue where it costs something.
        """
        lens = self._last.lens
        if lens is None:
            return None
        number = self._last.evidence.number[lens.group.key]
        where, location = locate(self._last, number, lens.theta)
        keys = [*self.used, lens.group.key]
        fit = self._fit(keys, "The fit with the lens failed")
        if fit is None:
            return None
        cost = Cost.of(self._now, fit, self._rows)
        told = {
            "rms_px": location["rms_px"],
            "most_px": location["most_px"],
            "where": where,
            "log_evidence": lens.evidence,
            "ground_m": cost.metres,
            "ground_sigmas": cost.sigmas,
            "held_out_ratio": cost.ratio,
        }
        if cost.counts:
            new = Unknown(
                lens.group.slug, "unknown", lens.evidence, where, location,
                number=number, theta=lens.theta,
            )  # fmt: skip
            self.findings = replace(self.findings, unknown=[*self.findings.unknown, new])
            self._go_on(keys, fit)
        return told | {"costs": cost.counts}

    def _prove_images(self) -> None:
        """Say no effect of single images for sure that predicts nothing that no fit has used.

        Residuals of one image hang together, and values for each image follow them; what is there
        tells of the other points of the image too, in one strip as in the next.
        """
        if not len(self._rows):
            return
        groups = {group.key: group for group in self._last.evidence.groups}
        for one in self.findings.effects:
            if one.kind == "suspected" or one.key not in self.used:
                continue
            if groups[one.key].own is None:
                continue
            others = [key for key in self.used if key != one.key]
            bare = self._fit(others, f"The fit without {one.key} failed")
            if bare is None:
                continue
            if Prediction.between(bare, self._now, self._rows).proved:
                continue
            tie = tie_gap(bare, self._now, self._rows)
            self.notes.append(
                f"{one.key} explains what was measured, but image points that no fit has used are "
                f"predicted hardly better with it ({tie['before']:.3f} px, then "
                f"{tie['after']:.3f}; strips differ by more): it is not taken for sure, and not "
                "added."
            )
            one.kind = "suspected"
            self._go_on(others, bare)

    def _drop_idle(self) -> None:
        """Drop shapes of single pictures that change nothing: residuals always hang together."""
        groups = self._last.evidence.groups
        for one in list(self.findings.unknown):
            if one.group not in self.used or groups[one.number].effect.place != "image":
                continue
            others = [key for key in self.used if key != one.group]
            bare = self._fit(others, f"The fit without {one.group} failed")
            if bare is None or Cost.of(bare, self._now, self._rows).counts:
                continue
            called = groups[one.number].effect.called
            self.notes.append(
                f"Residuals hang together as in {called} ({one.where}); it neither moves the "
                "ground nor predicts data that no fit has used clearly better, and is no finding."
            )
            self.findings = replace(
                self.findings, unknown=[k for k in self.findings.unknown if k is not one]
            )
            self._go_on(others, bare)

    def _keep_shapes(self) -> None:
        """Drop the generic groups with which held-out data are predicted no better."""
        generic = [one.group for one in self.findings.unknown]
        if not generic:
            return
        others = [key for key in self.used if key not in generic]
        said = "The fit without the unknown failed"
        bare = self._fit(others, said) if others else self._first
        if bare is None or improves(bare, self._now, self._rows):
            return
        self.notes.append(
            f"The correction by {', '.join(generic)} is not kept: data that no fit has used "
            "are predicted no better with it."
        )
        for one in self.findings.unknown:
            one.correction = "useless"
        self._go_on(others, bare)

    def _choose_effects(self) -> None:
        """Of effects that cannot be told apart, the one that predicts clearly better."""
        for one in self.findings.effects:
            if one.kind != "ambiguous" or one.key not in self.used:
                continue
            before = list(self.used)

            def instead(rival: str, one: Estimate = one, before: list[str] = before) -> list[str]:
                return [rival if key == one.key else key for key in before]

            rivals = [key for key in one.rivals if key not in before][: SETTINGS.most_rivals]
            fits = self._fits(rivals, instead)
            best, share = preferred(self._now, fits, self._rows)
            self.rivals |= share
            if best is None:
                continue
            kind = "check points" if "check" in share[best] else "held-out image points"
            self.notes.append(
                f"The fit cannot tell {one.key} and {best} apart; {kind} are predicted better "
                f"with {best}, so their error afterwards is no longer independent."
            )
            self._go_on(instead(best), fits[best])

    def _choose_control(self) -> None:
        """Of control points that contradict each other, the wrong ones by the check points.

        Two that were given too low say the same as a third that was given too high.
        """
        wrong = self._last.wrong
        if wrong.found is None or not wrong.alike:
            return
        groups = self._last.evidence.groups
        before = list(self.used)
        mine = [groups[n].key for n in wrong.found.points]

        def instead(which: int) -> list[str]:
            keys = [groups[n].key for n in wrong.alike[which].points]
            return [*keys, *(key for key in before if key not in (*mine, *keys))]

        some = range(min(len(wrong.alike), SETTINGS.most_rivals))
        fits = self._fits(some, instead) if len(self._now.check_points) else {}
        misfit = {k: check_misfit(fit) for k, fit in fits.items()}
        best = min(misfit, key=misfit.get, default=None)
        told = listed_points(groups, wrong.alike[: SETTINGS.most_rivals])
        if best is None or check_misfit(self._now) - misfit[best] < -SETTINGS.check_odds:
            clear = best is not None
        else:
            clear = check_misfit(self._now) - misfit[best] > SETTINGS.check_odds
            if clear:
                self.findings = other_control(self.findings, self._last, wrong.alike[best])
                self._go_on(instead(best), fits[best])
        if clear:
            self.notes.append(
                "The fit cannot tell which control points are wrong "
                f"({listed_points(groups, [wrong.found])}, or {told}); check points tell, so their "
                "error afterwards is no longer independent."
            )
            return
        for one in self.findings.effects:
            if one.key in mine:
                one.kind, one.instead = "ambiguous", told
                one.separate = "one more control point, or a check point, near those in question"

    def _ask_all_ground(self) -> None:
        """Say control points wrong that agree with each other, and with no check point.

        They are left out where that brings the fit nearer to the check points: without them the
        GNSS alone may know the heights worse.
        """
        check, groups = self._now.check_points, self._last.evidence.groups
        blunder = next((g.effect for g in groups if g.point is not None), None)
        if blunder is None or self._last.wrong.found is not None or not len(check):
            return
        if not contradicted(check_misfit(self._now), 3 * len(check)):
            return
        of_points = {g.key for g in groups if g.point is not None}
        rest = [key for key in self.used if key not in of_points]
        try:
            told = AllGround.of(self._believed, self._last, members(self._effects, rest), blunder)
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"Check points could not be asked for wrong control: {failed}")
            return
        if told.wrong.found is None:
            return
        points = listed_points(told.evidence.groups, [told.wrong.found, *told.wrong.alike])
        self.notes.append(
            f"Control and check points contradict each other, which {points} being wrong explains: "
            "the error of check points afterwards is no longer independent."
        )
        new = told.estimates({str(g.point) for g in groups if g.point is not None})
        if not new:
            return
        keys = [*rest, *(one.key for one in new)]
        fit = self._fit(keys, f"The fit without {points} failed")
        kept = [one for one in self.findings.effects if one.key not in of_points]
        self.findings = replace(self.findings, effects=[*new, *kept])
        if fit is not None and fit.check_rms.d3 < self._now.check_rms.d3:
            self._go_on(keys, fit)

    def _choose_shapes(self) -> None:
        """A shape of no catalogue in the place of look-alikes, where check points speak for it.

        A knock that moves the lens between strips flown to and fro is, to the fit, an error of the
        GNSS, and the named effect has fewer parameters.
        """
        if len(self._now.check_points) < SETTINGS.enough_checks:
            return
        groups = self._last.evidence.groups
        alike = {e.key: e for e in self.findings.effects if e.kind == "ambiguous"}
        for key, effect in alike.items():
            mine = next((k for k in [key, *effect.rivals] if k in self.used), None)
            if mine is None:
                continue
            before = list(self.used)

            def instead(shape: str, mine: str = mine, before: list[str] = before) -> list[str]:
                return [shape if k == mine else k for k in before]

            numbers = {groups[n].key: n for n in shapes(self._last, key)[: SETTINGS.most_shapes]}
            fits = self._fits(numbers, instead)
            best = best_by_far(self._now, fits)
            if best is None:
                continue
            self.notes.append(
                f"The fit cannot tell {mine} and {best} apart; check points are predicted better "
                f"by far with {best}, so their error afterwards is no longer independent."
            )
            self.findings = in_place_of(self.findings, self._last, key, numbers[best])
            self._go_on(instead(best), fits[best])

    def _drop_harmful(self) -> None:
        """Say no effect for sure that takes the check points away from where they were surveyed."""
        while True:
            keys = dict.fromkeys(
                one.key for one in self.findings.effects if one.kind != "suspected"
            )
            for key in [key for key in keys if key in self.used][::-1]:
                others = [k for k in self.used if k != key]
                bare = self._fit(others, f"The fit without {key} failed") if others else self._first
                if bare is None or not harms(bare, self._now):
                    continue
                self.notes.append(
                    f"{key} explains what was measured, but {_told(bare)} of check points become "
                    f"{_told(self._now)} with it, which their sigmas do not allow: it is not taken "
                    "for sure, and not added."
                )
                for one in self.findings.effects:
                    if one.key == key:
                        one.kind = "suspected"
                self._go_on(others, bare)
                break
            else:
                return


def check_misfit(adjustment: Adjustment) -> float:
    """Sum of squares of what check points are off by, in their sigmas and those of the survey."""
    table = adjustment.check_points.set_index("point")
    block = adjustment.system.block
    rows = pd.Index(block.ground["point"].astype(str)).get_indexer(table.index.astype(str))
    survey = block.ground_sigma()[rows]
    sigma = np.hypot(table[["sx", "sy", "sz"]].to_numpy(), survey)
    return float(((table[["dx", "dy", "dz"]].to_numpy() / sigma) ** 2).sum())


def harms(without: Adjustment, with_it: Adjustment) -> bool:
    """Whether check points contradict what an adjustment has more than another.

    They move by s when it is added. If it is true, they end at zero but for their noise, so the
    differences d afterwards do not point along s more often than that noise lets them. What common
    errors do to all of them alike is allowed for by taking each axis as one number.
    """
    before, after = (one.check_points.set_index("point") for one in (without, with_it))
    if not len(before) or not with_it.check_rms.d3 > without.check_rms.d3:
        return False
    d = after[["dx", "dy", "dz"]].to_numpy()
    s = d - before.loc[after.index, ["dx", "dy", "dz"]].to_numpy()
    block = without.system.block
    rows = pd.Index(block.ground["point"].astype(str)).get_indexer(after.index.astype(str))
    survey = block.ground_sigma()[rows]
    sigma = np.hypot(before.loc[after.index, ["sx", "sy", "sz"]].to_numpy(), survey)
    noise = np.sqrt(((np.abs(s) * sigma).sum(axis=0) ** 2).sum())
    return bool((d * s).sum() > SETTINGS.harm_sigma * noise)


def _told(adjustment: Adjustment) -> str:
    return f"{1000 * adjustment.check_rms.d3:.0f} mm"


def preferred(
    second: Adjustment, rivals: dict[str, Adjustment], rows: np.ndarray
) -> tuple[str | None, dict[str, dict[str, float]]]:
    """The rival that does clearly better than `second` where no fit has looked, None without one.

    Check points decide where there are enough of them, tie observations held out where not. Also
    the error of each rival over that of `second`: `tie`, `check`.
    """
    share: dict[str, dict[str, float]] = {}
    many = len(second.check_points) >= SETTINGS.enough_checks
    for key, fit in rivals.items():
        share[key] = {}
        if many:
            share[key]["check"] = float(fit.check_rms.d3 / second.check_rms.d3)
        found = tie_gap(second, fit, rows)
        if found["before"]:
            share[key]["tie"] = found["after"] / found["before"]
    kind, limit = (
        ("check", SETTINGS.clear_ratio_checks) if many else ("tie", SETTINGS.clear_ratio_ties)
    )
    known = {key: one[kind] for key, one in share.items() if kind in one}
    best = min(known, key=known.get, default=None)
    return (best if best is not None and known[best] < limit else None), share


def best_by_far(second: Adjustment, fits: dict[str, Adjustment]) -> str | None:
    """The fit with less than half the check-point error of `second`, None without one.

    fits: what fits best comes first, and is taken where the errors differ by no more than chance.
    """
    error = {key: float(fit.check_rms.d3) for key, fit in fits.items()}
    least = min(error.values(), default=np.inf)
    if least >= SETTINGS.clear_ratio_shape * second.check_rms.d3:
        return None
    return next(key for key, e in error.items() if SETTINGS.clear_ratio_checks * e <= least)


def improves(without: Adjustment, with_it: Adjustment, rows: np.ndarray) -> bool:
    """Whether held-out ties are predicted better, and check points, where many, no worse."""
    if len(with_it.check_points) >= SETTINGS.enough_checks:
        if SETTINGS.clear_ratio_checks * with_it.check_rms.d3 > without.check_rms.d3:
            return False
    if harms(without, with_it):
        return False
    found = tie_gap(without, with_it, rows)
    return bool(found["after"] < found["before"])


def check_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of check points, m; None without any."""
    if not len(before.check_points):
        return None
    return {"before": float(before.check_rms.d3), "after": float(after.check_rms.d3)}


def gnss_gap(before: Adjustment, after: Adjustment) -> dict[str, float] | None:
    """3D RMS of the antenna residuals, m; None without GNSS."""
    if not len(before.system.gnss.names):
        return None

    def rms(one):
        table = one.residuals["gnss"]
        return float(np.sqrt(np.mean((table[["vx", "vy", "vz"]].to_numpy() ** 2).sum(axis=1))))

    return {"before": rms(before), "after": rms(after)}


def closure(before: float, after: float, floor: float) -> float | None:
    """Share of the excess variance that is gone: (before^2 - after^2) / (before^2 - floor^2)."""
    excess = before**2 - floor**2
    return float((before**2 - after**2) / excess) if excess > 0 else None
