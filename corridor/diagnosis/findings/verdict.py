"""What the evidence amounts to: named, suspected, ambiguous, unknown or nothing.

An effect is ambiguous where another one explains the data as well. That is judged by the fit: an
effect of three parameters that contains one of one parameter pays for the other two in evidence,
and cannot be told apart from it all the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from corridor.core.block import Block
from corridor.core.effects import EffectValues
from corridor.core.geometry import jackknife, sigma_by_test
from corridor.diagnosis.evidence.evidence import Evidence, inverted
from corridor.diagnosis.evidence.profile_likelihood import signs
from corridor.diagnosis.findings.findings import Estimate, Findings, Unknown
from corridor.diagnosis.findings.location import locate
from corridor.diagnosis.findings.strips import ByStrips, by_strips
from corridor.diagnosis.forward_selection import Course, Round
from corridor.diagnosis.settings import SETTINGS
from corridor.diagnosis.system.groups import Group

# Random signs that tell how much an image's values are seen: to a few per cent.
_SIGNS = 24


def findings(course: Course) -> Findings:
    """What the last round says."""
    one = course.last
    evidence, found = one.evidence, one.found
    numbers = list(found.chosen)
    effects: list[Estimate] = []
    thetas, spreads = parameters(one)
    strips = by_strips(one)
    for n in numbers:
        if not evidence.groups[n].generic:
            effects += _estimates(one, n, thetas[n], spreads[n], strips.get(n))
    unknown = []
    for n in numbers:
        if evidence.groups[n].generic:
            kind = "unknown" if kind_of(one, n) == "named" else "suspected"
            new = Unknown(evidence.groups[n].slug, kind, found.evidence[n], parts=_parts(one, n))
            unknown.append(_at(one, new, n, thetas[n]))
    unproved = {evidence.groups[n].key: float(s.gain.sum()) for n, s in strips.items()}
    unproved = {key: gain for key, gain in unproved.items() if gain <= 0.0}
    return Findings(effects, unknown, unproved)


def _at(one: Round, unknown: Unknown, n: int, theta: np.ndarray) -> Unknown:
    where, location = locate(one, n, theta)
    return replace(unknown, where=where, location=location, number=n, theta=theta)


def in_place_of(found: Findings, one: Round, key: str, shape: int) -> Findings:
    """Findings with a generic group in the place of an effect that cannot be told apart."""
    evidence = one.evidence
    n, group = evidence.number[key], evidence.groups[shape]
    gone = [e for e in found.effects if e.key == key]
    rest = {k: v for k, v in one.found.chosen.items() if k != n}
    gain = evidence.given(rest)[shape]
    theta, _ = evidence.solution(rest | {shape: gain.kappa}, each_image=False)
    theta = theta[shape]
    alike = list(dict.fromkeys([gone[0].slug, *gone[0].alternatives]))
    new = Unknown(group.slug, "unknown", gain.evidence, alike=alike)
    unknown = [*found.unknown, _at(one, new, shape, theta)]
    return Findings([e for e in found.effects if e.key != key], unknown)


def _parts(one: Round, n: int) -> list[str]:
    """Named effects that would explain some of what a generic group explains, the best first."""
    evidence, chosen = one.evidence, one.found.chosen
    without = evidence.given({k: v for k, v in chosen.items() if k != n})
    beside = evidence.given(chosen)
    out = [
        k
        for k, group in enumerate(evidence.groups)
        if not group.generic
        and k not in chosen
        and without[k].evidence
        > max(one.threshold["named"], SETTINGS.overlap_share * without[n].evidence)
        and beside[k].fit < SETTINGS.same_fit_share * without[k].fit
    ]
    out.sort(key=lambda k: -without[k].evidence)
    return list(dict.fromkeys(evidence.groups[k].slug for k in out))[: SETTINGS.most_rivals]


def kind_of(one: Round, n: int) -> str:
    """Whether a group that a round found is `named`, by its evidence, or only `suspected`."""
    if n in one.found.kept:
        return "named"
    return "named" if one.found.evidence[n] > limit_of(one, n) else "suspected"


def limit_of(one: Round, n: int) -> float:
    """Log evidence beyond which a group is named."""
    return one.threshold["beside_noise" if _like_noise(one, n) else "named"]


def _like_noise(one: Round, n: int) -> bool:
    """Whether an effect can pass for slow noise of the GNSS, and was judged beside it."""
    place = one.evidence.groups[n].effect.place
    return place in ("antenna", "ground") and one.noises.touches(n) > SETTINGS.gnss_share_main


def parameters(one: Round) -> tuple[dict, dict]:
    """Parameters of each group found, and their covariance, in prior standard deviations.

    All groups of the model together, with the noise of the GNSS as it was estimated and as
    uncertain as that is. Small groups have no prior but what can happen.
    """
    evidence, chosen = one.evidence, one.found.chosen
    loose = evidence.freed(chosen)
    found = None
    if any(one.noises.touches(n) > SETTINGS.gnss_share for n in chosen):
        found = one.noises.parameters(loose, one.noise, np.random.default_rng(0))
    theta, covariance = found or evidence.solution(loose)
    return theta, {n: evidence.honest(n, spread) for n, spread in covariance.items()}


def _estimates(one: Round, n: int, theta, spread, strips: ByStrips | None = None) -> list[Estimate]:
    """strips: the group as they see it. Its sigma counts where it contradicts the other one."""
    evidence, found = one.evidence, one.found
    group = evidence.groups[n]
    theta = theta * group.scale
    sigma = formal = np.sqrt(spread.diagonal()) * group.scale
    kind = kind_of(one, n)
    if strips is not None:
        each = zip(formal, strips.sigma * group.scale, strict=True)
        sigma = np.array([sigma_by_test(*pair, strips.count - 1) for pair in each])
        kind = kind if strips.proved else "suspected"
    # What a test of its own has found has had its rivals there.
    alike = [] if n in found.kept else alternatives(evidence, found.chosen, n)
    made = Estimate(group.slug, kind, found.evidence[n], [], key=group.key)
    made.or_one_of(group, [evidence.groups[k] for k in alike])
    if group.own is not None:
        return [_of_images(made, group, one.equations.system.block, theta, sigma)]
    cameras = len(one.equations.system.images.camera_names)
    changes = _changes(group, theta, spread, strips) if group.effect.group == "flight" else {}
    return [
        replace(
            made,
            parameters=rows_of(group, owner, theta, sigma, formal),
            where=_where(group, owner, cameras),
            change=changes.get(owner, []),
        )
        for owner in dict.fromkeys(owner for owner, *_ in group.labels)
    ]


def _changes(group: Group, theta, spread, strips: ByStrips | None) -> dict[str, list[dict]]:
    """Of each flight but the first, its parameters less those of the flight before.

    theta (p,): in the parameters' units; spread (p, p): in prior standard deviations. What all
    flights have in common may be the camera's, and unknown; how they differ is not.
    """
    owners = list(dict.fromkeys(owner for owner, *_ in group.labels))
    at = {(owner, name): k for k, (owner, name, _) in enumerate(group.labels)}
    out: dict[str, list[dict]] = {}
    for before, owner in zip(owners, owners[1:], strict=False):
        rows = []
        for mine, name, unit in group.labels:
            if mine != owner or (before, name) not in at:
                continue
            k, b = at[owner, name], at[before, name]
            sigma = np.sqrt(max(spread[k, k] + spread[b, b] - 2.0 * spread[k, b], 0.0))
            if strips is not None:
                left = jackknife(strips.left[:, k] - strips.left[:, b])
                sigma = sigma_by_test(sigma, left, strips.count - 1)
            value, sigma = float(theta[k] - theta[b]), float(sigma * group.scale[k])
            rows.append({"name": name, "value": value, "sigma": sigma, "unit": unit})
        out[owner] = rows
    return out


def rows_of(group: Group, owner: str, value, sigma, formal) -> list[dict]:
    """Parameters of an estimate: value, sigma and formal sigma (p,) of a group, those of one owner.

    The formal sigma is told where it is another one.
    """
    return [
        {"name": name, "value": float(value[k]), "sigma": float(sigma[k]), "unit": unit}
        | ({} if sigma[k] == formal[k] else {"sigma_formal": float(formal[k])})
        for k, (mine, name, unit) in enumerate(group.labels)
        if mine == owner
    ]


def _where(group: Group, owner: str, cameras: int) -> dict:
    """What one estimate of a group is of: a point, a distance, a flight, one of several cameras."""
    if group.single is not None:
        return {group.effect.group: group.single}
    kind = group.effect.group
    return {kind: owner} if kind == "flight" or (kind == "camera" and cameras > 1) else {}


def _of_images(made: Estimate, group: Group, block: Block, theta, sigma) -> Estimate:
    """An estimate of an effect with values for each image: their root mean square, and all."""
    parameters = group.effect.parameters(block)
    # Labels are image by image.
    values, sigmas = (each.reshape(-1, len(parameters)) for each in (theta, sigma))
    size, error = (np.sqrt(np.mean(each**2, axis=0)) for each in (values, sigmas))
    rows = [
        {
            "name": parameter.name,
            "value": float(size[k]),
            "sigma": float(error[k] / np.sqrt(len(values))),
            "unit": parameter.unit,
            "statistic": "root mean square over the images",
        }
        for k, parameter in enumerate(parameters)
    ]
    images = [str(owner) for owner, *_ in group.labels[:: len(parameters)]]
    of_each = EffectValues(group.effect, images, parameters, values, sigmas)
    return replace(made, parameters=rows, values=of_each)


def alternatives(evidence: Evidence, chosen: dict, n: int) -> list[int]:
    """Groups that explain what the n-th group of a model does as well as it does."""
    rest = {k: v for k, v in chosen.items() if k != n}
    gains = evidence.given(rest)
    mine, group = gains[n], evidence.groups[n]
    out = []
    for k, gain in enumerate(gains):
        other = evidence.groups[k]
        if k == n or k in chosen or other.generic or refines(other, group):
            continue
        equal = mine.evidence - gain.evidence <= SETTINGS.look_alike_log_odds
        # Sets of values, one a flight, are one more parameter each and no other shape.
        more = len(parameter_names(other)) - len(parameter_names(group))
        # More parameters than that have to fit better, by more than they would by chance (twice the
        # fit of what is not there is chi square) and by what the physics of the other leave.
        chance = 0.5 * float(chdtri(max(len(other) - len(group), 1), SETTINGS.doubt_level))
        chance += SETTINGS.leftover_share * mine.fit
        contained = (
            other.own is None
            and (more <= SETTINGS.look_alike_more_parameters or gain.fit - mine.fit > chance)
            and mine.fit - gain.fit <= SETTINGS.look_alike_log_odds
        )
        # Where an effect is weak, what explains nothing is not far behind, and no explanation.
        if (equal or contained) and gain.fit > SETTINGS.same_fit_share * mine.fit:
            out.append(k)
    return sorted(out, key=lambda k: -gains[k].evidence)


def near_rivals(one: Round, n: int) -> list[int]:
    """Groups that may stand in the place of the n-th group of a model, the best first.

    Named effects of as few parameters, each of which would be named without the n-th, and explains
    most of what it does. Beside none of them is the n-th beyond doubt.
    """
    evidence, chosen = one.evidence, one.found.chosen
    rest = {k: v for k, v in chosen.items() if k != n}
    gains, group = evidence.given(rest), evidence.groups[n]

    def near(k: int) -> bool:
        other, gain = evidence.groups[k], gains[k]
        if k in chosen or other.generic or other.own is not None or other.single is not None:
            return False
        more = len(parameter_names(other)) - len(parameter_names(group))
        if more > SETTINGS.look_alike_more_parameters or refines(other, group):
            return False
        if gain.evidence <= one.threshold["named"]:
            return False
        if gain.fit <= SETTINGS.same_fit_share * gains[n].fit:
            return False
        beside = evidence.given(rest | {k: gain.kappa}, only=n)[n]
        return beside.evidence <= SETTINGS.clear_evidence

    return sorted(filter(near, range(len(gains))), key=lambda k: -gains[k].evidence)


def shapes(one: Round, key: str) -> list[int]:
    """Generic groups that fit as well as a group of the model, the best first."""
    evidence, chosen = one.evidence, one.found.chosen
    n = evidence.number[key]
    gains = evidence.given({k: v for k, v in chosen.items() if k != n})

    if evidence.groups[n].own is not None:
        return []
    out = {
        k: evidence.beyond_chance(k, gains[k])
        for k, group in enumerate(evidence.groups)
        if group.generic
        and group.own is None
        and k not in chosen
        and np.isfinite(gains[k].evidence)
    }
    mine = evidence.beyond_chance(n, gains[n])
    return sorted(
        (k for k in out if mine - out[k] <= SETTINGS.look_alike_log_odds), key=lambda k: -out[k]
    )


def parameter_names(group: Group) -> set[str]:
    """Names of the parameters of one set."""
    return {name for _, name, _ in group.labels}


def refines(a: Group, b: Group) -> bool:
    """Whether a is b with more sets of values: a lever arm each flight, a time each image."""
    return a.effect.refines == b.slug and len(a) > len(b)


def detection_limits(one: Round) -> dict[str, dict[str, float | None]]:
    """Smallest value of each parameter that would have been seen, by slug and name.

    4.5 standard deviations of the parameter with the others of its group known to be small (one
    prior standard deviation); of values for each image, the root mean square that the variance
    shows. None where this block says nothing. Beside what was found, as free as it is: another
    cause of the same would have been taken for that.

    What the antenna alone feels can pass for its own slow noise, of which the size is estimated
    too: chi square grows with the logarithm of the effect then, as of Student's t, and the limit is
    where it reaches that of 4.5 standard deviations: nu (exp(4.5^2 / nu) - 1) = (limit / sigma)^2.
    """
    evidence = one.evidence
    nu = one.noises.freedom(one.noise) if not one.noises.few else np.inf
    through_noise = (
        float(np.sqrt(nu * np.expm1(SETTINGS.detection_sigma**2 / nu)))
        if np.isfinite(nu)
        else SETTINGS.detection_sigma
    )
    out: dict[str, dict[str, float | None]] = {}
    found = evidence.freed(evidence.of_core(one.found.chosen))
    left = evidence.beside(found).M if found else evidence.reduced.M
    for n, group in enumerate(evidence.groups):
        if group.generic:
            continue
        mine = out.setdefault(group.slug, {})
        if group.own is not None:
            names = list(dict.fromkeys(label[1] for label in group.labels))
            for name in names:
                rows = [k for k, label in enumerate(group.labels) if label[1] == name]
                sign = np.zeros((len(group), _SIGNS))
                sign[rows] = signs(len(rows), _SIGNS)
                moved, _ = evidence.reduced.elimination.spread(group, sign)
                # The mean of z'M'Mz is the sum of squares of M.
                power = np.sqrt(0.5 * np.mean((moved[rows] ** 2).sum(axis=0)))
                power /= evidence.inflation[n]
                scale = group.scale[rows[0]]
                mine[name] = (
                    float(np.sqrt(SETTINGS.detection_sigma / power) * scale)
                    if power > 1e-6
                    else None
                )
            continue
        others = {k: size for k, size in found.items() if k != n}
        core = evidence.beside(others).M if n in found and others else left
        core = evidence.reduced.M if n in found and not others else core
        M = core[np.ix_(group.columns, group.columns)] / evidence.inflation[n]
        times = through_noise if _like_noise(one, n) else SETTINGS.detection_sigma
        sigma = np.sqrt(inverted(M + np.eye(len(M)))[0].diagonal())
        for k, (_, name, _) in enumerate(group.labels):
            size = times * sigma[k] / np.sqrt(max(1.0 - sigma[k] ** 2, 1e-30))
            # Where no size that happens would be seen, the prior is all that is known.
            limit = None if size > SETTINGS.implausible_size else float(size * group.scale[k])
            best = mine.get(name)
            mine[name] = limit if best is None else (max(best, limit) if limit else best)
    return out
