"""From a flight plan to a block: what would be measured, and what is true."""

from __future__ import annotations

import json
import numbers
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd

from corridor.core import effects as catalogue
from corridor.core.block import POSE, QUATERNION, Block
from corridor.core.camera import INTERIOR
from corridor.core.errors import InputError
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)
from corridor.core.output import Progress, telling, whole_file
from corridor.core.simulation.fly import Flown, bank_of, check_plan, fly, ground_width
from corridor.core.simulation.ground_points import evenly, surveyed
from corridor.core.simulation.noise import add_noise
from corridor.core.simulation.plan import (
    ORDINARY_NOISE,
    Ground,
    Noise,
    Plan,
    Start,
    TiePoints,
    build,
    read_plan,
    value_of,
)
from corridor.core.simulation.terrain import Dike
from corridor.core.simulation.views import Network, Views, matched, thin

# Observations that fit in memory with all that hangs on them.
_MOST_OBSERVATIONS = 200_000_000
# Of points that are only candidates, in 4 GB; and how often the points of a picture that is asked
# for a number of them may be seen, until it is the heights that are to blame.
_MOST_SHOWN, _UNLIKE = 100_000_000, 20
# Points that an image sees for one that it measures, where a matcher does not know all again.
_UNMATCHED = 8


@dataclass(eq=False, repr=False)
class Simulated(Block):
    """A block that nobody flew. `truth`: a mapping of everything that is true of it.

    It is a block, not a pair of block and truth: everything that takes a block takes it, and
    nothing but a comparison with the truth asks which it is. Copies and selections are plain
    blocks: what is changed in them the truth does not know.
    """

    truth: dict = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, block: Block, truth: dict) -> Simulated:
        """The block with what is true of it."""
        return cls(**{one.name: getattr(block, one.name) for one in fields(Block)}, truth=truth)

    def write(self, folder: str | os.PathLike, form: str = "csv", observed: bool = True) -> None:
        """Write the block folder, and the truth beside it to FOLDER.truth.json; both or neither.

        See `Block.write`; `copy().write` leaves the truth out.
        """
        folder = Path(folder)
        path = folder.parent / f"{folder.name}.truth.json"
        lines = ",\n".join(f"{json.dumps(k)}: {_lines(v)}" for k, v in self.truth.items())
        with whole_file(path) as part:
            part.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8", newline="\n")
            super().write(folder, form, observed)


def simulate(
    plan: Plan | str | os.PathLike,
    effects: Mapping[str, Mapping] | None = None,
    seed: int = 0,
    *,
    noise: Noise | Mapping | str | None = None,
    start: Start | Mapping | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Simulated:
    """The block that a flight plan would give.

    plan: a `Plan`, a `.toml` file, or names of ready-made plans joined by +.
    effects: `{slug: {parameter: value}}`, on top of the plan's own.
    noise, start: in place of the plan's: errors of measurement, and of the start values. Without
        noise, or with `none`, all rays of a point meet in it; `ordinary` is that of the command.
    progress: called with a `Progress` whose `done` is a share.

    The start values in the block (poses, points, camera) miss the truth by what `start` says; what
    is true is in `.truth`, and `write` puts it beside the block's folder, never into it.
    Same plan and seed, same block. Raises InputError for a plan that cannot be flown.
    """
    plan = plan if isinstance(plan, Plan) else read_plan(plan)
    say = telling(progress)
    if effects is not None and not isinstance(effects, Mapping):
        raise InputError(
            f"effects = {effects!r}: give values by slug and parameter, as in "
            "{'rolling_shutter': {'readout': 0.03}}"
        )
    added = {**plan.effects, **(effects or {})}
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"seed = {seed!r} is not a whole number from 0")
    noise = _settings(noise, plan.noise, Noise)
    start = _settings(start, plan.start, Start)
    _check_camera(start)
    _check_effects(plan, added)

    perfect = perfect_block(plan, seed, progress)
    block = perfect
    catalogue.refuse_impossible(block, added, catalogue.Values.of(block, added))
    if added:
        say("adding effects", 0.0, 1.0)
        block = catalogue.add(block, added)
        say("adding effects", 1.0, 1.0)
    say("adding noise", 0.0, 1.0)
    block = add_noise(block, noise=noise, seed=seed)
    block = _miss(block, start, np.random.default_rng([seed, 7]))
    say("adding noise", 1.0, 1.0)
    return Simulated.of(block, _truth(perfect, plan, seed, added, noise))


def perfect_block(
    plan: Plan, seed: int = 0, progress: Callable[[Progress], None] | None = None
) -> Block:
    """The block of a plan without any error: start values are the truth, all rays meet.

    Shapes, units and errors as `simulate`; the plan's effects, noise and start are left aside.
    """
    say = telling(progress)
    low, high = ground_of(plan, seed).bounds
    images = check_plan(plan, high)
    per_image = plan.tie_points.per_image
    if images * per_image > _MOST_OBSERVATIONS:
        raise InputError(
            f"{images} images with {per_image} tie points each are more than "
            f"{_MOST_OBSERVATIONS:.0e} observations: lower per_image or fly less"
        )
    draw = [np.random.default_rng(child) for child in np.random.SeedSequence([seed, 3]).spawn(5)]
    flown = fly(plan, seed)
    network = Network(flown, low, high, plan.tie_points.border_px)

    def look(station, across, progress=None):
        place = on_the_ground(plan, seed, station, across)
        return _Points(station, across, place, network.look(place, progress))

    seen = look(
        *_candidates(plan, flown, network, draw[0]),
        lambda share: say("looking what pictures show", share, 1.0),
    ).of_a_matcher(plan.tie_points, flown.centre, draw[1])
    begin, end = float(flown.station.min()), float(flown.station.max())
    *where, role = surveyed(plan.ground, begin, end, bank_of(plan), draw[2])
    marked = look(*where)
    picked = _check_points(plan.ground, seen, begin, end, draw[3])
    ties, checks = seen.of(np.setdiff1d(np.arange(len(seen.place)), picked)), seen.of(picked)

    say("writing tables", 0.0, 1.0)
    image_name = pd.Index(flown.table["image"], dtype="str")
    tie_names = _names("T", len(ties.place))
    mark_names = _names("G", len(marked.place), 2) + _names("C", len(picked))
    all_marked = np.concatenate([marked.place, checks.place])
    all_marks = Views(
        np.concatenate([marked.views.start, marked.views.start[-1] + checks.views.start[1:]]),
        np.concatenate([marked.views.image, checks.views.image]),
    )
    block = Block(
        name=plan.name,
        cameras={camera.name: camera for camera in flown.cameras},
        images=flown.table,
        tie_points=_observed(tie_names, image_name, ties.place, ties.views, network),
        points=pd.DataFrame({"point": tie_names, **_xyz(ties.place)}),
        marks=_observed(mark_names, image_name, all_marked, all_marks, network),
        ground=pd.DataFrame(
            {
                "point": mark_names,
                **_xyz(all_marked),
                "role": [*role.tolist(), *["check"] * len(picked)],
            }
        ),
        distances=_bars(plan.ground, ties, tie_names, draw[4]),
        extra=_constants(plan),
        gnss=pd.DataFrame({"image": image_name, **_xyz(flown.antenna)})[flown.leads & plan.gnss],
        attitudes=flown.table[["image", *QUATERNION]][flown.leads] if plan.attitudes else None,
        # One weight for all image points, as long as no noise says otherwise.
        sigma={"tie_px": 0.5, "mark_px": 0.5},
        lever_arm={f.name: (*f.lever_arm_m,) for f in plan.flights} if plan.gnss else {},
        description=plan.description or f"simulated from the plan {plan.name}",
        source=plan.source,
    )
    say("writing tables", 1.0, 1.0)
    return block


def ground_of(plan: Plan, seed: int) -> Dike:
    """The ground that a plan is flown over."""
    terrain = plan.terrain
    return Dike(terrain.relief_m, terrain.level_m, seed, terrain.roughness_m)


def on_the_ground(plan: Plan, seed: int, station, across) -> np.ndarray:
    """Positions (n, 3), metres, at stations and distances to the right of the axis (n,)."""
    height = ground_of(plan, seed).height(station, across)
    return np.column_stack([plan.axis.place(station, across), height])


def marks_on(plan: Plan, seed: int, names: Sequence[str], places: np.ndarray) -> pd.DataFrame:
    """What the images of a plan measure of ground points (n, 3), m, without any error."""
    flown = fly(plan, seed)
    network = Network(flown, *ground_of(plan, seed).bounds, plan.tie_points.border_px)
    images = pd.Index(flown.table["image"], dtype="str")
    return _observed(names, images, places, network.look(places), network)


@dataclass
class _Points:
    """Points of the ground and who sees them: station, across (n,), place (n, 3), metres."""

    station: np.ndarray
    across: np.ndarray
    place: np.ndarray
    views: Views

    def of(self, rows: np.ndarray) -> _Points:
        """Some of the points, in the order given."""
        return _Points(self.station[rows], self.across[rows], self.place[rows], self.views.of(rows))

    def of_a_matcher(
        self, ties: TiePoints, centre: np.ndarray, draw: np.random.Generator
    ) -> _Points:
        """As many as give an image `per_image`, numbered as they appear in the flight.

        centre (images, 3): of the images, metres.
        """
        views, limits = self.views, ties.limits
        if limits != (None, None):
            away = centre[views.image] - self.place[views.point]
            views = matched(views, away, *limits, draw)
        kept = thin(views, len(centre), ties.per_image, draw)
        if not len(kept):
            raise InputError(
                "no point is seen twice: raise forward or side overlap, or what tie_points say of "
                "matching"
            )
        first = views.image[views.start[kept]]
        return replace(self, views=views).of(kept[np.argsort(first, kind="stable")])


def _candidates(
    plan: Plan, flown: Flown, network: Network, draw: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Station and distance from the axis of points drawn evenly over all that pictures show."""
    position, tangent = plan.axis.at(flown.station)
    away = network.footprints - position[:, None]
    right = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    along = flown.station[:, None] + np.einsum("mnk,mk->mn", away, tangent)
    aside = np.einsum("mnk,mk->mn", away, right)
    box = np.array([[along.min(), along.max()], [aside.min(), aside.max()]])
    width = np.array([np.prod(ground_width(plan.camera(f), f.long_side)) for f in plan.flights])
    smallest = float(np.min(width * [f.heights.min() ** 2 for f in plan.flights]))
    per_image = plan.tie_points.per_image
    if plan.tie_points.limits != (None, None):
        per_image *= _UNMATCHED
    # Images at the rim share less ground with others and need their points more densely.
    count = int(np.prod(np.ptp(box, axis=1)) * per_image / smallest * 2) + 100
    # Pictures from high above see all the points that the lowest ones need.
    areas = np.prod(np.ptp(network.footprints, axis=1), axis=1)
    shown = float(areas.sum() * per_image / smallest * 2)
    unlike = shown > _MOST_SHOWN and shown > _UNLIKE * network.images * per_image
    if count > _MOST_OBSERVATIONS or unlike:
        raise InputError(
            f"{count:.0e} points, seen {shown:.0e} times, are needed to give the lowest pictures "
            f"{plan.tie_points.per_image} each: lower per_image, or plan flights of such "
            "different heights apart"
        )
    return tuple(draw.uniform(box[:, 0], box[:, 1], (count, 2)).T)


def _check_points(
    ground: Ground, seen: _Points, begin: float, end: float, draw: np.random.Generator
) -> np.ndarray:
    """Rows of the tie points that serve as check points, evenly over the part that is flown."""
    if not ground.check_from_ties:
        return np.empty(0, dtype=np.int64)
    fit = (seen.views.multiplicity >= 3) & (seen.station >= begin) & (seen.station <= end)
    if ground.within_m is not None:
        fit &= np.abs(seen.across) <= ground.within_m
    rows = np.flatnonzero(fit)
    return rows[evenly(seen.station[rows], seen.across[rows], ground.check_from_ties, draw)]


def _bars(
    ground: Ground, ties: _Points, names: list[str], draw: np.random.Generator
) -> pd.DataFrame | None:
    """Distances between pairs of tie points, as true as they are."""
    fit = np.flatnonzero(ties.views.multiplicity >= 3)
    if not ground.bars or len(fit) < 2:
        return None
    place, free = ties.place[fit], np.ones(len(fit), bool)
    rows = []
    for first in evenly(ties.station[fit], ties.across[fit], ground.bars, draw).tolist():
        if not free[first]:
            continue
        free[first] = False
        apart = np.linalg.norm(place - place[first], axis=1)
        second = int(np.argmin(np.where(free, np.abs(apart - ground.bar_m), np.inf)))
        if free[second]:
            free[second] = False
            rows.append((names[fit[first]], names[fit[second]], float(apart[second])))
    return pd.DataFrame(rows, columns=["from", "to", "distance"])


def _settings(given, plans, kind):
    """Settings in place of the plan's: a table, all of them, or noise by its name."""
    if given is None or isinstance(given, kind):
        return plans if given is None else given
    where = kind.__name__.lower()
    if isinstance(given, str) and kind is Noise:
        known = {"ordinary": ORDINARY_NOISE, "none": Noise()}
        if given not in known:
            raise InputError(
                f"noise {given!r} is unknown: use ordinary, none, or a table of sigmas"
            )
        return known[given]
    if not isinstance(given, Mapping):
        raise InputError(f"{where} is a table, not {given!r}")
    return build(kind, {**vars(plans), **given}, where)


def _check_camera(start: Start) -> None:
    for key, value in start.camera.items():
        if key not in INTERIOR:
            raise InputError(
                f"start: camera has no parameter {key!r}: it has {', '.join(INTERIOR)}"
            )
        value_of(value, float, f"start: camera: {key}")


def _constants(plan: Plan) -> dict:
    """The tables [effect.SLUG], as a block has them."""
    stated = {slug: dict(table) for slug, table in plan.effect.items()}
    rigs = {"rig": {name: dict(rig) for name, rig in plan.rig.items()}} if plan.rig else {}
    return {"effect": stated, **rigs} if stated else rigs


def _check_effects(plan: Plan, effects: Mapping) -> None:
    """Try the effects on one image a flight, so that wrong ones are refused before it is flown."""
    if not effects:
        return
    tried = {}
    for slug, values in effects.items():
        effect = catalogue.effect_of(slug)
        tried[slug] = values
        if isinstance(values, np.ndarray):
            # One row for each group, which are not known yet.
            tried[slug] = {}
            continue
        if not isinstance(values, Mapping):
            raise InputError(f"effects: {slug} is a table of its parameters, not {values!r}")
        for parameter, value in values.items():
            for number in value.values() if isinstance(value, Mapping) else [value]:
                value_of(number, float, f"effects: {slug}: {parameter}")
        if effect.generic:
            # How many parameters a shape has depends on the block.
            tried[slug] = {}
        elif effect.group in ("image", "point"):
            # Images and points have no names yet.
            tried[slug] = dict.fromkeys(values, 0.0)
    taken = [(f.name, c) for f in plan.flights for c in (f.camera, *plan.members(f.camera))]
    names = [f"{flight} {camera}" for flight, camera in taken]
    flights = [flight for flight, _ in taken]
    zero = np.zeros(len(names))
    known = ("time_s", "temperature_c", *POSE, "vx", "vy", "vz", "wx", "wy", "wz")
    pose = {"image": names, **dict.fromkeys(known, zero), "qw": zero + 1.0}
    sketch = Block(
        name=plan.name,
        cameras={
            **{flight.camera: plan.camera(flight) for flight in plan.flights},
            **{camera: plan.cameras[camera] for camera in plan.mountings if camera in plan.cameras},
        },
        images=pd.DataFrame(
            {**pose, "flight": flights, "exposure": flights, "camera": [c for _, c in taken]}
        ),
        ground=pd.DataFrame(
            {"point": ["G"], **dict.fromkeys("xyz", zero[:1]), "role": ["control"]}
        ),
        gnss=pd.DataFrame({key: pose[key] for key in ("image", *"xyz")})[: len(names) * plan.gnss],
        attitudes=pd.DataFrame({key: pose[key] for key in ("image", *QUATERNION)})[
            : len(names) * plan.attitudes
        ],
        extra=_constants(plan),
    )
    catalogue.predict(sketch, tried)


def _miss(block: Block, start: Start, draw: np.random.Generator) -> Block:
    """The block with start values that miss the truth, and without what nobody knows yet."""
    count = len(block.images)
    rotation = rotation_from_quaternion(block.poses[:, 3:])
    turn = rotation_from_vector(np.radians(start.rotation_deg) * draw.standard_normal((count, 3)))
    quaternion = quaternion_from_rotation(turn @ rotation)
    centre = block.poses[:, :3] + start.centre_m * draw.standard_normal((count, 3))
    block.put("images", POSE, np.concatenate([centre, quaternion], axis=1))
    points = block.numbers("points", *"xyz")
    block.put("points", "xyz", points + start.points_m * draw.standard_normal(points.shape))
    block.cameras = {
        name: camera.with_values(**{k: camera[k] + v for k, v in start.camera.items()})
        for name, camera in block.cameras.items()
    }
    block.lever_arm = {}
    return block


def _truth(perfect: Block, plan: Plan, seed: int, effects: Mapping, noise: Noise) -> dict:
    def rows(table: pd.DataFrame, name: str, columns) -> dict:
        return dict(
            zip(table[name].tolist(), table[list(columns)].to_numpy().tolist(), strict=True)
        )

    return {
        "block": plan.name,
        "seed": seed,
        "noise": asdict(noise),
        "camera": {name: camera.to_table() for name, camera in perfect.cameras.items()},
        "effects": catalogue.Values.of(perfect, effects).plain(),
        "lever_arm": {name: list(arm) for name, arm in perfect.lever_arm.items()},
        "centre": rows(perfect.images, "image", "xyz"),
        "quaternion": rows(perfect.images, "image", QUATERNION),
        "ground": rows(perfect.ground, "point", "xyz"),
        "points": rows(perfect.points, "point", "xyz"),
    }


def _lines(value: object) -> str:
    """JSON with one line for each name, so that a person can read it."""
    if isinstance(value, dict) and value and isinstance(next(iter(value.values())), list):
        inside = ",\n".join(f"  {json.dumps(k)}: {json.dumps(v)}" for k, v in value.items())
        return f"{{\n{inside}\n}}"
    return json.dumps(value)


def _names(letter: str, count: int, digits: int = 6) -> list[str]:
    digits = max(digits, len(str(count)))
    return [f"{letter}{k:0{digits}d}" for k in range(1, count + 1)]


def _xyz(points: np.ndarray) -> dict:
    return {axis: np.ascontiguousarray(points[:, k]) for k, axis in enumerate("xyz")}


def _observed(names, images: pd.Index, points, views: Views, network: Network) -> pd.DataFrame:
    """Rows of tie_points or marks; names: of points, images: of images."""
    x, y = network.pixels(points, views).T
    point = pd.Categorical.from_codes(views.point, categories=pd.Index(names, dtype="str"))
    image = pd.Categorical.from_codes(views.image, categories=images)
    x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
    return pd.DataFrame({"point": point, "image": image, "x": x, "y": y})
