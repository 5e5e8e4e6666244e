"""What a diagnosis found: effects with their values, what is of no catalogue, and the verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from corridor.core.brief import brief
from corridor.core.effects import EffectValues
from corridor.diagnosis.system.groups import Group

# The verdict is the first that is present.
ORDER = ("named", "ambiguous", "unknown", "suspected", "nothing")
# What became of the shape that stands for an unknown, as diagnosis.json says it under `kept`:
# data that no fit has used are predicted better with it, or no better; or the fit takes what was
# found for wrong matches, and there is nothing to add.
Correction = Literal["helps", "useless", "none"]
KEPT: dict[str, bool | None] = {"helps": True, "useless": False, "none": None}


@brief
@dataclass
class Estimate:
    """One effect that was found (for a flight or a camera of its own, one each).

    kind: `named`, `ambiguous` or `suspected`. parameters: name, value, sigma, unit, and
    sigma_formal where the jackknife over strips contradicts that and gives the sigma; of an effect
    with values for each image, their root mean square, and values has those of the images.
    alternatives: slugs that cannot be told apart from it. separate: what would. key, rivals: of
    its group, and of theirs (see `Group`). instead: control points that may be wrong in its place.
    change: of a flight but the first, its parameters less those of the flight before, with the
    sigma of that difference. untold: why its size cannot be told, where it cannot.
    """

    slug: str
    kind: str
    log_evidence: float
    parameters: list[dict]
    alternatives: list[str] = field(default_factory=list)
    separate: str = ""
    where: dict = field(default_factory=dict)
    key: str = ""
    rivals: list[str] = field(default_factory=list)
    values: EffectValues | None = None
    instead: str = ""
    change: list[dict] = field(default_factory=list)
    untold: str = ""

    def or_instead(self, points: str) -> None:
        """Other control points may be wrong in its place."""
        self.kind, self.instead = "ambiguous", points
        self.separate = "one more control point, or a check point, near those in question"

    def or_one_of(self, group: Group, others: Iterable[Group]) -> None:
        """Other groups may be missing in the place of its own; nothing where there are none."""
        others = list(others)
        if not others:
            return
        self.kind = "ambiguous" if self.kind == "named" else self.kind
        alike = [*self.alternatives, *(other.slug for other in others)]
        self.alternatives = [slug for slug in dict.fromkeys(alike) if slug != group.slug]
        self.rivals = [*self.rivals, *(other.key for other in others)]
        revealed = [one.effect.revealed_by for one in (group, *others)]
        self.separate = "; or ".join(dict.fromkeys([*filter(None, [self.separate]), *revealed]))

    def to_dict(self, used: list[str], rivals: dict[str, dict[str, float]]) -> dict:
        """An entry of `effects` in diagnosis.json; used, rivals: see `Diagnosis`."""
        out = {
            "slug": self.slug,
            "class": self.kind,
            "log_evidence": self.log_evidence,
            "parameters": self.parameters,
            "cannot_be_told_apart_from": self.alternatives,
            **self.where,
            **({"or_instead": self.instead} if self.instead else {}),
            **({"change_from_flight_before": self.change} if self.change else {}),
            **({"size_cannot_be_told": self.untold} if self.untold else {}),
        }
        if self.values is not None:
            out |= {"group": self.values.kind, "values": self.values.to_json()}
        if not self.rivals:
            return out
        return out | {
            "separated_by": self.separate,
            "adjusted_with": next((k for k in [self.key, *self.rivals] if k in used), None),
            "held_out": {key: rivals[key] for key in self.rivals if key in rivals},
        }


@brief
@dataclass
class Unknown:
    """Something outside the catalogue, told as the generic group that shows it.

    group: slug. kind: `unknown` or `suspected`. where, location: in words, and with the keys of
    diagnosis.json. parts: named effects that it overlaps. alike: named effects that fit as well,
    where check points have decided. number, theta: of the group in the last
    round and its parameters (p,), in prior sigmas; -1 of what no group was fitted to.
    """

    group: str
    kind: str
    log_evidence: float
    where: str = ""
    location: dict = field(default_factory=dict)
    correction: Correction = "helps"
    parts: list[str] = field(default_factory=list)
    alike: list[str] = field(default_factory=list)
    number: int = -1
    theta: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def to_dict(self) -> dict:
        """An entry of `unknown` in diagnosis.json."""
        return {
            "group": self.group,
            "log_evidence": self.log_evidence,
            "where": self.where,
            "location": self.location,
            "class": self.kind,
            "parts": self.parts,
            "kept": KEPT[self.correction],
            "cannot_be_told_apart_from": self.alike,
        }


@dataclass
class Findings:
    """All that was found, the strongest first.

    unproved: groups by key with which strips are predicted no better when they are left out, and
    by how much log likelihood worse.
    """

    effects: list[Estimate] = field(default_factory=list)
    unknown: list[Unknown] = field(default_factory=list)
    unproved: dict[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The first of `ORDER` that is present."""
        present = {one.kind for one in (*self.effects, *self.unknown)}
        return next((kind for kind in ORDER if kind in present), "nothing")
