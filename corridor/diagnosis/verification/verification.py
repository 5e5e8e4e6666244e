"""Does what was found help where the fit has not looked?

Of what the fit cannot tell apart held-out data choose, a shape stays only if they are predicted
better with it, and no effect stays that does harm to check points, or with which image points that
are held out are predicted worse (see `held_out`). GNSS residuals are those of the fits.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from corridor.core.adjustment import Adjustment
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis.evidence.blunders import listed_points
from corridor.diagnosis.evidence.profile_likelihood import beyond_noise
from corridor.diagnosis.evidence.scores import as_spread
from corridor.diagnosis.evidence.search import Found, tuned
from corridor.diagnosis.findings.findings import Findings, Unknown
from corridor.diagnosis.findings.location import locate
from corridor.diagnosis.findings.verdict import in_place_of, kind_of, limit_of, near_rivals, shapes
from corridor.diagnosis.forward_selection import Course
from corridor.diagnosis.reference import ReferenceModel
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.groups import Group
from corridor.diagnosis.verification.all_ground import AllGround, contradicted
from corridor.diagnosis.verification.held_out import (
    Cost,
    Prediction,
    check_gap,
    check_misfit,
    gnss_gap,
    harms,
    hold_out,
    improves,
    preferred,
    tie_gap,
    untold,
    worse,
)

# A direction of rows that another sensor, turned by a right angle, would have.
_ACROSS = {"down": "right", "up": "right", "right": "down", "left": "down"}


class Verification:
    """Fits with and without what was found, of which tie observations were held out.

    findings, used: what is left of what was found, and the keys of the model to go on with. rivals:
    error with effects that cannot be told apart from those found, over the error with those found,
    of `check` points and `tie` points. lens: what it is beside its polynomials and does to the
    ground. notes: a sentence on each choice.
    """

    def __init__(self, believed: ReferenceModel, course: Course, found: Findings, seed: int):
        self.findings, self.used = found, list(course.last.keys)
        self.rivals: dict[str, dict[str, float]] = {}
        self.notes: list[str] = []
        self.lens: dict | None = None
        for key in [key for key in self.used if key in found.unproved]:
            self.used.remove(key)
            self.notes.append(
                f"{key} explains what was measured, but strips are predicted no better with what "
                "the other strips say of it: it is not certain, and not added."
            )
        self._believed, self._course, self._last = believed, course, course.last
        self._groups = course.last.evidence.groups
        self._fitted: dict[frozenset[str], Adjustment] = {}
        self._by_checks: set[str] = set()  # What check points told, which no round has asked.
        self._block, self._held = believed.block, pd.MultiIndex.from_arrays([[], []])
        few = len(self._block.tie_points) <= SETTINGS.fewest_ties
        if not few:
            self._block, self._held = hold_out(self._block, np.random.default_rng(seed))
        said = "Held-out observations could not be compared"
        self._first = self._now = self._fit([], said, after=course.first)
        if self.used and self._first:
            same = set(self.used) == set(course.last.log["model"])
            self._now = self._fit(self.used, said, after=course.last.adjustment if same else None)
        if self._now is None:
            self._drop_suspected()
            return
        self._ask_all_ground()
        self._prove_images()
        self._drop_idle()
        self.lens = self._ask_lens()
        self._ask_rivals()
        if not few:
            self._keep_shapes()
            self._choose()
        self._drop_harmful()
        self._drop_lonely()
        self._drop_untold()
        self._drop_suspected()

    def gap(self, after: Adjustment) -> dict[str, dict | None]:
        """RMS before and after by what no fit has used, and of the antenna; see diagnosis.json.

        after: the adjustment of all observations with what was found.
        """
        tie: dict[str, float | None] = {"before": None, "after": None}
        if self._now is not None:
            tie = tie_gap(self._first, self._now, self._held)
        before = self._course.first
        return {
            "tie_px": tie,
            "check_m": check_gap(before, after),
            "gnss_m": gnss_gap(before, after),
        }

    def after(self) -> tuple[Adjustment, list[str]]:
        """The adjustment with what is left of what was found, and the keys of that."""
        last = self._last
        if set(self.used) == set(last.log["model"]):
            return last.adjustment, self.used
        if not self.used:
            return self._course.first, self.used
        try:
            members = self._course.members(self.used)
            return self._believed.adjust(members, after=self._now), self.used
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"The adjustment with what was found failed: {failed}")
            return last.adjustment, list(last.log["model"])

    def _fit(
        self, keys: Sequence[str], said: str, near: bool = False, after: Adjustment | None = None
    ) -> Adjustment | None:
        which = frozenset(keys)
        if which in self._fitted:
            return self._fitted[which]
        try:
            fit = self._believed.adjust(self._course.members(keys), self._block, near, after)
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"{said}: {failed}")
            return None
        # Several questions end at the same model; of large blocks each weighs gigabytes.
        if len(self._block.images) <= SETTINGS.large_block or not which:
            self._fitted[which] = fit
        return fit

    def _without(self, *keys: str) -> tuple[list[str], Adjustment | None]:
        """The model without some groups, and its fit."""
        others = [key for key in self.used if key not in keys]
        return others, self._fit(others, f"The fit without {', '.join(keys)} failed")

    def _with(self, key: str, instead: str) -> list[str]:
        """The model with a group in place of another."""
        return [key if one == instead else one for one in self.used]

    def _fits(self, others: Iterable[str], instead: str) -> dict[str, Adjustment]:
        """Fits with each of several groups in place of one, those that succeed."""
        tried = {
            key: self._fit(
                self._with(key, instead), f"The fit with {key} failed", near=True, after=self._now
            )
            for key in others
        }
        return {key: fit for key, fit in tried.items() if fit is not None}

    def _go_on(self, keys: list[str], fit: Adjustment) -> None:
        self.used, self._now = keys, fit

    def _ask_all_ground(self) -> None:
        """Say which control points are wrong, where check points tell more of it than the fit.

        Two that were given too low agree with each other, and say the same as a third that was
        given too high. They are left out where that brings the fit nearer to the check points:
        without them the GNSS alone may know the heights worse.
        """
        check, wrong = self._now.check_points, self._last.wrong
        single = {g.key: g for g in self._groups if g.single is not None}
        of_points = {key: g for key, g in single.items() if g.effect.place == "ground"}
        asked = bool(of_points) and len(check) > 0
        if asked and not wrong.alike:
            asked = contradicted(check_misfit(self._now), 3 * len(check))
        if asked and self._told_by_all(of_points):
            return
        told = listed_points(self._groups, wrong.alike[: SETTINGS.most_rivals])
        for one in self.findings.effects if told else ():
            if one.key in single:
                one.or_instead(told)

    def _told_by_all(self, of_points: dict[str, Group]) -> bool:
        """Whether all ground points together name control points; of_points: groups by key."""
        rest = [key for key in self.used if key not in of_points]
        blunder = next(iter(of_points.values())).effect
        try:
            told = AllGround.of(self._believed, self._last, self._course.members(rest), blunder)
        except (InputError, AdjustmentFailed) as failed:
            self.notes.append(f"Check points could not be asked for wrong control: {failed}")
            return False
        if told.wrong.found is None:
            return False
        points = listed_points(told.evidence.groups, [told.wrong.found, *told.wrong.alike])
        self.notes.append(
            f"Control and check points contradict each other, which {points} being wrong explains: "
            "the error of check points afterwards is no longer independent."
        )
        new = told.estimates({str(g.single) for g in of_points.values()})
        if not new:
            return False
        keys = [*rest, *(one.key for one in new)]
        fit = self._fit(keys, f"The fit without {points} failed")
        kept = [one for one in self.findings.effects if one.key not in of_points]
        self.findings = replace(self.findings, effects=[*new, *kept])
        if fit is not None and fit.check_rms.d3 < self._now.check_rms.d3:
            self._go_on(keys, fit)
        self._by_checks = {one.key for one in new}
        return True

    def _prove_images(self) -> None:
        """Say no effect of single images for sure that predicts nothing that was left out.

        Residuals of one image hang together, and values for each image follow them; what is there
        tells of the other points of the image too, in one strip as in the next. Each value rests
        on the points of its image alone, of which the few that no fit has used say little: all
        places are asked, in turn.
        """
        groups = {group.key: group for group in self._groups}
        for one in self.findings.effects if len(self._held) else ():
            if one.kind == "suspected" or one.key not in self.used or groups[one.key].own is None:
                continue
            others, bare = self._without(one.key)
            if bare is None:
                continue
            if not Prediction.of_folds(bare, self._now, self._held).proved:
                tie = tie_gap(bare, self._now, self._held)
                why = (
                    "image points that are left out are predicted hardly better with it "
                    f"({tie['before']:.3f} px, then {tie['after']:.3f}; strips differ by more)"
                )
            elif (
                share := self._by_columns(groups[one.key], others, bare)
            ) > SETTINGS.overlap_share:
                why = (
                    f"what nothing else looks like ({', '.join(groups[one.key].effect.proper)}) "
                    f"shows along the columns of the pictures too, {100 * share:.0f} % as clearly: "
                    "nothing says that it comes row by row"
                )
            else:
                continue
            self.notes.append(
                f"{one.key} explains what was measured, but {why}. It is not taken for sure, and "
                "not added."
            )
            one.kind = "suspected"
            self._go_on(others, bare)

    def _by_columns(self, group: Group, others: list[str], bare: Adjustment) -> float:
        """Evidence of what only motions during the readout look like (`proper`), were pictures read
        by columns, over that by rows.

        others, bare: the model without them, and its fit. 0 where a readout or rates are stated, or
        a motion that all images share shows one.
        """
        block = self._block
        stated = len(block.rates) > 0 or any(c.readout_s for c in block.cameras.values())
        shared = (g.effect for g in self._groups if g.key in others and g.own is None)
        if not group.effect.during_readout or stated or any(e.during_readout for e in shared):
            return 0.0
        across = {
            name: replace(one, row_direction=_ACROSS[one.row_direction])
            for name, one in block.cameras.items()
        }
        found = []
        for cameras in (block.cameras, across):
            turned = replace(block, cameras=cameras)
            try:
                fit = self._believed.adjust(self._course.members(others), turned, True, bare)
            except (InputError, AdjustmentFailed):
                return 0.0
            priors = self._believed.priors_of([group.effect])
            evidence = self._last.evidence_at(fit, [group.effect], priors, lens=False)
            (gain,) = evidence.given({})
            proper = np.array([n in group.effect.proper for _, n, _ in evidence.groups[0].labels])
            without = np.where(proper, 1.0 / SETTINGS.free_size, gain.kappa)
            found.append(max(evidence.total({0: gain.kappa}) - evidence.total({0: without}), 0.0))
        rows, columns = found
        return columns / rows if rows > 0.0 else 1.0

    def _drop_idle(self) -> None:
        """Drop shapes of single pictures that change nothing: residuals always hang together."""
        for one in list(self.findings.unknown):
            effect = self._groups[one.number].effect
            if one.group not in self.used or effect.place != "image":
                continue
            others, bare = self._without(one.group)
            if bare is None or Cost.of(bare, self._now, self._held).counts:
                continue
            self.notes.append(
                f"Residuals are correlated as in {effect.called} ({one.where}); it neither moves "
                "the ground nor predicts data that no fit has used clearly better, and is "
                "not a finding."
            )
            self.findings = replace(
                self.findings, unknown=[k for k in self.findings.unknown if k is not one]
            )
            self._go_on(others, bare)

    def _ask_lens(self) -> dict | None:
        """What the lens is beside its polynomials and does to the ground, None where it is nothing.

        It is told as something outside the catalogue where it costs something.
        """
        lens = self._last.lens
        if lens is None:
            return None
        key = lens.group.key
        keys, number = [*self.used, key], self._last.evidence.number[key]
        where, location = locate(self._last, number, lens.theta)
        fit = self._fit(keys, "The fit with the lens failed", after=self._now)
        if fit is None:
            return None
        cost = Cost.of(self._now, fit, self._held)
        if cost.counts:
            new = Unknown(
                lens.group.slug, "unknown", lens.evidence, where, location,
                number=number, theta=lens.theta,
            )  # fmt: skip
            self.findings = replace(self.findings, unknown=[*self.findings.unknown, new])
            self._go_on(keys, fit)
        return {
            "rms_px": location["rms_px"],
            "most_px": location["most_px"],
            "where": where,
            "log_evidence": lens.evidence,
            "ground_m": cost.metres,
            "ground_sigmas": cost.sigmas,
            "held_out_ratio": cost.ratio,
            "costs": cost.counts,
        }

    def _keep_shapes(self) -> None:
        """Drop the generic groups with which held-out data are predicted no better."""
        generic = [one.group for one in self.findings.unknown]
        if not generic:
            return
        others, bare = self._without(*generic)
        if bare is None or improves(bare, self._now, self._held):
            return
        self.notes.append(
            f"The correction by {', '.join(generic)} is not kept: data that no fit has used "
            "are predicted no better with it."
        )
        for one in self.findings.unknown:
            one.correction = "useless"
        self._go_on(others, bare)

    def _ask_rivals(self) -> None:
        """Say no effect alone that would not be named beside another in whose place it stands.

        A fit bends to what is in it, poses and weights: from there a rival looks worse than it is.
        So it is asked where the rival has been adjusted.
        """
        last = self._last
        for key in dict.fromkeys(one.key for one in self.findings.effects if one.kind == "named"):
            n = last.evidence.number.get(key)
            if n is None or n not in last.found.chosen or key not in self.used:
                continue
            if n in last.found.kept or self._groups[n].own is not None:
                continue
            keys = [self._groups[k].key for k in near_rivals(last, n)[: SETTINGS.most_rivals]]
            fits = self._fits(keys, key)
            alike = [
                self._groups[last.evidence.number[rival]]
                for rival, fit in fits.items()
                if self._beside(key, rival, fit) <= limit_of(last, n)
            ]
            for one in self.findings.effects:
                if one.key == key:
                    one.or_one_of(self._groups[n], alike)

    def _beside(self, key: str, rival: str, fit: Adjustment) -> float:
        """Evidence of a group of the model beside its rival, at the fit with that in its place."""
        last, number = self._last, self._last.evidence.number
        lens = None if last.lens is None else last.lens.group.key
        keys = dict.fromkeys(one for one in (*self.used, rival) if one in number and one != lens)
        effects = self._course.members(keys)
        evidence = last.evidence_at(fit, effects, self._believed.priors_of(effects))
        beside = {
            evidence.number[one]: last.found.chosen.get(number[one], 1.0)
            for one in keys
            if one != key
        }
        n = evidence.number[key]
        # Between groups that compete no factor on the scores of one counts: see `given`.
        return evidence.given(tuned(evidence, beside), only=n)[n].evidence

    def _choose(self) -> None:
        """Of what cannot be told apart, the one that check points speak for, or else held-out ties.

        Of effects one that predicts them clearly better; a shape of no catalogue by far better: a
        knock that moves the lens between strips flown to and fro is, to the fit, an error of the
        GNSS, and the named effect has fewer parameters.
        """
        for one in [one for one in self.findings.effects if one.kind == "ambiguous"]:
            mine = next((key for key in [one.key, *one.rivals] if key in self.used), None)
            if mine is None:
                continue
            named = [key for key in one.rivals if key not in self.used]
            many = len(self._now.check_points) >= SETTINGS.enough_checks
            some = shapes(self._last, one.key) if many else []
            drawn = {self._groups[n].key: n for n in some}
            for keys, limit in (
                (named, SETTINGS.clear_ratio_checks), (list(drawn), SETTINGS.same_fit_share)
            ):  # fmt: skip
                fits = self._fits(keys[: SETTINGS.most_rivals], mine)
                best, share = preferred(self._now, fits, self._held, limit)
                self.rivals |= {key: told for key, told in share.items() if key in named}
                if best is None:
                    continue
                witness = "check points" if many else "held-out image points"
                self.notes.append(
                    f"The fit cannot separate {mine} and {best}; {witness} are predicted better "
                    f"with {best}, so their error afterwards is no longer independent."
                )
                if best in drawn:
                    self.findings = in_place_of(self.findings, self._last, one.key, drawn[best])
                self._go_on(self._with(best, mine), fits[best])
                mine = best

    def _drop_harmful(self) -> None:
        """Say no effect for sure that takes the check points away from where they were surveyed, or
        what is predicted of the pictures from what they show."""
        while (harmful := self._harmful()) is not None:
            key, others, bare, which = harmful
            if which == "check points":
                was, now = (f"{1000 * one.check_rms.d3:.0f} mm" for one in (bare, self._now))
            else:
                was, now = (f"{e:.3f} px" for e in tie_gap(bare, self._now, self._held).values())
            self.notes.append(
                f"{key} explains what was measured, but {was} of {which} become {now} with it: it "
                "is not taken for sure, and not added."
            )
            for one in self.findings.effects:
                if one.key == key:
                    one.kind = "suspected"
            self._go_on(others, bare)

    def _drop_lonely(self) -> None:
        """Say no effect for sure that the data speak for only beside what did not stand."""
        last, numbers = self._last, self._last.evidence.number
        # The lens is in the equations of that round; what took the place of another counts for it.
        lens = None if last.lens is None else last.lens.group.key
        at = [numbers[key] for key in self.used if key in numbers and key != lens]
        was = last.found.chosen
        gone = [self._groups[n].key for n in was if n not in at]
        if not gone:
            return
        left = {n: was.get(n, 1.0) for n in at}
        left = tuned(last.evidence, left) if left.keys() - was.keys() else left
        found = Found.of(last.evidence, left, last.found.kept & left.keys())
        found = as_spread(last.evidence, beyond_noise(last.noises, found, -np.inf), -np.inf)
        alone = replace(last, found=found)
        for one in [one for one in self.findings.effects if one.key not in self._by_checks]:
            n = numbers.get(one.key)
            if n in left and one.kind != "suspected" and kind_of(alone, n) == "suspected":
                self.notes.append(
                    f"{one.key} explains what was measured beside {', '.join(gone)}, and hardly "
                    "anything without: it is not taken for sure, and not added."
                )
                one.kind = "suspected"

    def _drop_suspected(self) -> None:
        """Add nothing that is only suspected."""
        kinds = {one.group: one.kind for one in self.findings.unknown}
        kinds |= {one.key: one.kind for one in self.findings.effects}
        doubtful = [key for key in self.used if kinds.get(key) == "suspected"]
        if doubtful:
            others, bare = self._without(*doubtful)
            self._go_on(others, bare or self._now)

    def _harmful(self) -> tuple[str, list[str], Adjustment, str] | None:
        """The weakest effect that does harm, the model without it, its fit, and to what.

        Where something unknown bends the pictures, it makes good control points contradict the
        rest as well: a point is not called wrong there if check points are off by any more.
        """
        groups = {group.key: group for group in self._groups}
        bent = any(
            self._groups[one.number].effect.place == "image" for one in self.findings.unknown
        )
        # Check points that something else bends, which is not in the model, are no judge of what is
        # beyond doubt.
        bent_too = len(self._now.check_points) and contradicted(
            check_misfit(self._now), 3 * len(self._now.check_points)
        )
        firm = dict.fromkeys(
            one.key
            for one in self.findings.effects
            if one.kind != "suspected"
            and not (bent_too and one.log_evidence > SETTINGS.clear_evidence)
        )
        for key in reversed([key for key in firm if key in self.used]):
            others, bare = self._without(key)
            if bare is None:
                continue
            # Points that all ground was asked for are no group of the last round.
            doubtful = bent and key in groups and groups[key].single is not None
            if harms(bare, self._now) or (
                doubtful and len(bare.check_points) and self._now.check_rms.d3 > bare.check_rms.d3
            ):
                return key, others, bare, "check points"
            if worse(bare, self._now, self._held):
                return key, others, bare, "image points that are left out"
        return None

    def _drop_untold(self) -> None:
        """Say no effect for sure, and no value of it, whose size cannot be told."""
        groups = {group.key: group for group in self._groups}
        for one in self.findings.effects:
            if one.key not in groups or one.kind == "suspected" or one.key not in self.used:
                continue
            one.untold = untold(one, groups[one.key].effect, self._now)
            if one.untold:
                self.notes.append(
                    f"{one.key} explains what was measured, but its size cannot be told: "
                    f"{one.untold}. It is not taken for sure, and not added."
                )
                one.kind = "suspected"
