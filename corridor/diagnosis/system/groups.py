"""Groups of columns that are tested together: an effect that could be missing, or one point.

Each effect gives columns, the derivative of the observations by its parameters, in units of the
parameters' prior standard deviations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from corridor.core.adjustment import Columns
from corridor.core.effects import Effect
from corridor.diagnosis.settings import SETTINGS

# Groups of values of which one at a time may be wrong, each a measurement of its own.
SINGLE = ("point", "distance")


@dataclass
class Group:
    """Columns that are tested together.

    key: the slug, and for one control point or distance, `single`, with its name: `slug.name`.
    own: None where the columns lie in the core; else the number of the block of per-image columns.
    columns: (p,) in there. scale: (p,) prior standard deviations of the parameters. labels: (p,) of
    (name of group, parameter, unit). mean: (p,) prior mean in standard deviations. known: the prior
    comes from the user. most: (p,) sizes beyond which the cause is another one, None of values for
    each image.
    """

    key: str
    effect: Effect
    own: int | None
    columns: np.ndarray
    scale: np.ndarray
    labels: list[tuple[str, str, str]]
    log_prior: float = 0.0
    single: str | None = None
    mean: np.ndarray | None = None
    known: bool = False
    most: np.ndarray | None = None

    @property
    def slug(self) -> str:
        """Public name of the effect."""
        return self.effect.slug

    @property
    def generic(self) -> bool:
        """Whether it stands for the unknown."""
        return self.effect.generic

    @property
    def free(self) -> np.ndarray:
        """Prior sigmas (p,), in prior standard deviations, of parameters left as free as they are.

        What is larger than `most` does not happen: twice this sigma. A value that the flight
        knows is moved by nothing to speak of, one that it does not know stays near zero.
        """
        wide = np.full(len(self), SETTINGS.free_size)
        if self.most is None:
            return wide
        return np.minimum(wide, self.most / self.scale / SETTINGS.implausible_sigma)

    def part(self, at: list[int]) -> Group:
        """The group with some of its parameters."""
        return replace(
            self,
            columns=self.columns[at],
            scale=self.scale[at],
            labels=[self.labels[k] for k in at],
            most=None if self.most is None else self.most[at],
        )

    def __len__(self) -> int:
        return len(self.columns)


def make_groups(
    columns: Columns, controls: int, effects: Iterable[Effect], priors: Mapping
) -> list[Group]:
    """Groups of the columns of a system in which the candidates are effects.

    controls: how many control points there are. priors: by `slug.parameter` or slug, (mean,
    standard deviation) in the parameter's unit.
    """
    effects = sorted(effects, key=lambda effect: effect.place == "antenna")
    slugs = {effect.slug for effect in effects}
    shared = [u for u in columns.shared if u.kind == "effect" and u.owner in slugs]
    owns = [slug for slug in columns.of_image if slug in slugs]
    out = []
    for effect in effects:
        parameters = columns.parameters[effect.slug]
        if effect.slug in owns:
            labels = [(name, p.name, p.unit) for name in columns.images for p in parameters]
            scale = np.tile([p.scale for p in parameters], len(columns.images))
            own, at = owns.index(effect.slug), np.arange(len(labels))
            out.append(
                Group(effect.slug, effect, own, at, scale, labels, SETTINGS.log_prior_per_image)
            )
            continue
        entries = [(n, u.group, u.at[1]) for n, u in enumerate(shared) if u.owner == effect.slug]
        names = dict.fromkeys(name for _, name, _ in entries)
        single = effect.group in SINGLE and not effect.generic
        for part in names if single else [None] * bool(entries):
            mine = [entry for entry in entries if part is None or entry[1] == part]
            labels = [(name, parameters[k].name, parameters[k].unit) for _, name, k in mine]
            key = effect.slug if part is None else f"{effect.slug}.{part}"
            of = controls if effect.place == "ground" else len(names)
            log_prior = -np.log(of) if part is not None else 0.0
            scale = np.array([parameters[k].scale for *_, k in mine])
            at = np.array([column for column, *_ in mine])
            most = np.array([parameters[k].most for *_, k in mine])
            out.append(Group(key, effect, None, at, scale, labels, log_prior, part, most=most))
    for group in out:
        group.log_prior += (
            SETTINGS.log_prior_generic * group.generic
            + SETTINGS.log_prior_ground * (group.effect.place in ("ground", "distance"))
        )
        _with_prior(group, priors)
    return out


def _with_prior(group: Group, priors: Mapping) -> None:
    """Laboratory knowledge of a candidate: what is named so, and zero of the rest of it."""
    given = [
        priors.get(f"{group.slug}.{name}", priors.get(group.slug) if k == 0 else None)
        for k, (_, name, _) in enumerate(group.labels)
    ]
    if not any(given):
        return
    first = group.scale.copy()
    group.known = True
    group.mean = np.zeros(len(group))
    for k, prior in enumerate(given):
        if prior:
            group.scale[k] = prior[1]
            group.mean[k] = prior[0] / prior[1]
        else:
            group.scale[k] = first[k]


class OfSome(Effect):
    """An effect of ground points, or distances, for some of them only."""

    def __init__(self, effect: Effect, names: list[str]):
        super().__init__(effect.group)
        self.inner, self.names = effect, set(names)
        for name in Effect.__annotations__:
            setattr(self, name, getattr(effect, name))

    def parameters(self, block):
        return self.inner.parameters(block)

    def shift(self, context, values):
        """As of the effect; nothing moves the others."""
        mine = np.array([name in self.names for name in context.names], dtype=float)
        shift, derivative = self.inner.shift(context, values)
        return shift * mine[:, None], derivative * mine[:, None, None]


def of_some(effect: Effect, names: list[str]) -> Effect:
    """The effect, for these points or distances where it is one of those."""
    return OfSome(effect, names) if effect.group in SINGLE and names else effect
