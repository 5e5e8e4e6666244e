"""What each physical effect of the catalogue would leave in the residuals.

An effect moves the modelled observations; poses, points and the believed model follow as far as
they can; what they leave is the effect's signature. Most of an effect is gone by then, and the
rest is far below the noise of a single observation, but all observations share it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from corridor.effects import Stack, every_effect

# Share of an effect that has to be left after absorption: below, rounding would speak.
LEFT = 1e-3
# Largest shift at which a signature is taken, px and m: the model is linear that far.
REACH_PX, REACH_M = 1.0, 0.1
MOST_POINTS, MOST_GROUPS = 12, 12


@dataclass(frozen=True, eq=False)
class Signatures:
    """Signatures after absorption, weighted and normed: rows are independent unit directions.

    names: of the effects. start: (effects + 1,) where the rows of each begin. pixels
    (rows, 2 n), gnss (rows, 3 k), control (rows, 3 c): multiply with residuals and add up; noise
    of the stated size gives rows of variance 1. absorbed: effects that leave nothing.
    """

    names: tuple[str, ...]
    start: np.ndarray
    pixels: np.ndarray
    gnss: np.ndarray
    control: np.ndarray
    absorbed: tuple[str, ...]

    def strengths(self, pixels: np.ndarray, gnss: np.ndarray, control: np.ndarray) -> np.ndarray:
        """What residuals share with each effect (effects,), in standard deviations.

        With its sign where an effect has one direction, else the length over all of them.
        """
        # The matrix is single precision: residuals in double would be copied to it anew.
        rows = self.pixels @ pixels.astype(np.float32).ravel()
        rows = rows.astype(float) + self.gnss @ gnss.ravel() + self.control @ control.ravel()
        first = self.start[:-1]
        length = np.sqrt(np.add.reduceat(rows**2, first))
        return np.where(np.diff(self.start) == 1, rows[first], length)


def signatures(replicator) -> Signatures | None:
    """Signatures of the physical effects that the believed model lacks; None where all are gone.

    replicator: see `corridor.diagnosis.replicator.Replicator`. Effects of single images have no
    common signature (see `of_single_images`); those of a control point have one for each point.
    """
    system = replicator.system
    sigmas = np.repeat(system.image_rows.sigma, 2), system.gnss.sigma, system.control.sigma
    weights = [sigma.ravel() ** -2.0 for sigma in sigmas]
    names, absorbed, start = [], [], [0]
    kept: tuple[list, list, list] = ([], [], [])
    for name, moved in _moved(replicator):
        raw, left = [], []
        for pixels, gnss, control in moved:
            reach = max(
                np.abs(pixels).max(initial=0.0) / REACH_PX,
                np.abs(gnss).max(initial=0.0) / REACH_M,
                np.abs(control).max(initial=0.0) / REACH_M,
            )
            if reach == 0:
                continue
            parts = pixels / reach, gnss / reach, control / reach
            raw.append(_norm(parts, weights))
            fit = replicator.absorb(*parts)
            left.append([part.ravel() for part in (fit.pixels, fit.gnss, fit.control)])
        if not left:
            continue
        columns = [np.stack([one[k] for one in left]) for k in range(3)]
        matrix = sum((c * w) @ c.T for c, w in zip(columns, weights, strict=True))
        size = np.array(raw)
        value, vector = np.linalg.eigh(matrix / size[:, None] / size)
        good = value > LEFT**2
        if not good.any():
            absorbed.append(name)
            continue
        turn = (vector[:, good] / np.sqrt(value[good])).T / size
        names.append(name)
        start.append(start[-1] + int(good.sum()))
        # Single precision: a large block has a million residuals for each row.
        for k, kind in enumerate((np.float32, float, float)):
            kept[k].append(((turn @ columns[k]) * weights[k]).astype(kind))
    if not names:
        return None
    stacked = [np.concatenate(part) for part in kept]
    return Signatures(
        tuple(names), np.array(start), stacked[0], stacked[1], stacked[2],
        tuple(absorbed),
    )  # fmt: skip


def of_single_images(replicator) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Signatures of the physical effects that each image has for itself: one a parameter.

    Name, pixels (n, 2) and gnss (k, 3): shifts by one prior standard deviation, before absorption.
    """
    return [
        (f"{name} {parameter}", pixels, gnss)
        for name, parameter, (pixels, gnss, _) in _moved_singly(replicator)
    ]


def _moved_singly(replicator):
    for effect, seen, parameters, groups in _missing_effects(replicator):
        if effect.group != "image":
            continue
        here = seen(np.zeros((groups, len(parameters))))
        for number, parameter in enumerate(parameters):
            values = np.zeros((groups, len(parameters)))
            values[:, number] = parameter.scale
            there = seen(values)
            yield effect.slug, parameter.name, [h - t for h, t in zip(here, there, strict=True)]


def _moved(replicator):
    """Name and shifts (pixels, gnss, control) by each parameter, of each effect in turn."""
    controls = replicator.system.control_names
    for effect, seen, parameters, groups in _missing_effects(replicator):
        if effect.group == "image":
            continue
        if groups > (MOST_POINTS if effect.group == "point" else MOST_GROUPS):
            continue
        shape = groups, len(parameters)
        here = seen(np.zeros(shape))

        def column(group, number, seen=seen, here=here, parameters=parameters, shape=shape):
            values = np.zeros(shape)
            values[group, number] = parameters[number].scale
            # Residuals are measured minus modelled: a modelled shift lowers them.
            return tuple(h - t for h, t in zip(here, seen(values), strict=True))

        if effect.group == "point":
            for g in range(groups):
                yield f"{effect.slug} {controls[g]}", [column(g, n) for n in range(shape[1])]
        else:
            yield (
                effect.slug,
                [column(g, n) for g in range(shape[0]) for n in range(shape[1])],
            )


def _missing_effects(replicator):
    """Physical effects that the model lacks and the block could show.

    Yields the effect, a function from its values to residuals (pixels, gnss, control), its
    parameters and how many groups it has.
    """
    system = replicator.system
    controls = list(system.control_names)
    for effect in every_effect():
        if effect.generic or effect.slug in system.effects:
            continue
        if effect.missing(system.block):
            continue
        if effect.place == "antenna" and not len(system.gnss.names):
            continue
        if effect.place == "ground" and not controls:
            continue
        tested = system.testing([effect])

        def seen(values, tested=tested, effect=effect):
            effects = {**tested.state.effects, effect.slug: values}
            left = tested.at(replace(tested.state, effects=effects)).residuals()
            # Residuals are measured minus modelled; what was measured stays.
            return left.pixels, left.gnss, left.control

        member = Stack(system.block, [effect], controls).members[effect.slug]
        yield effect, seen, member.parameters, len(member.groups)


def _norm(parts, weights) -> float:
    return float(
        np.sqrt(sum(w @ part.ravel() ** 2 for part, w in zip(parts, weights, strict=True)))
    )
