"""A block as arrays that the kernels can run over, and the list of its unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from corridor.adjustment.kernels import PANEL
from corridor.adjustment.model import CAMERA, EFFECT, LEVER_ARM, Model, ParameterId, Setting
from corridor.adjustment.ordering import bandwidth, corridor_order
from corridor.block import Block
from corridor.camera import INTERIOR
from corridor.effects import (
    Arrays,
    Effect,
    EffectValues,
    Images,
    Stack,
    Values,
    group_names,
    group_of_image,
    stated_lever_arms,
)
from corridor.errors import InputError


@dataclass(frozen=True)
class Unknown(ParameterId):
    """One unknown that images share. at: where its value lives (row, column of its table)."""

    unit: str = ""
    at: tuple[int, int] = (0, 0)

    @property
    def label(self) -> str:
        """Public name: `camera.P1.f`, `rolling_shutter.readout`, `lever_arm.F1.z`."""
        return str(self)


@dataclass
class State:
    """Values of everything that is estimated; images in the order of the problem.

    centre (m, 3), rotation (m, 3, 3); points (n, 3); interior (cameras, 15); effects: slug ->
    (groups, parameters); arms (flights, 3).
    """

    centre: np.ndarray
    rotation: np.ndarray
    points: np.ndarray
    interior: np.ndarray
    effects: Arrays
    arms: np.ndarray


@dataclass
class Problem:
    """Everything that stays the same from one iteration to the next."""

    block: Block
    model: Model
    images: Images
    order: np.ndarray  # image row of each position
    ptr: np.ndarray
    img: np.ndarray
    xy: np.ndarray
    weight: np.ndarray
    row: np.ndarray  # observation row: ties first, then marks
    tie_count: int
    point_codes: np.ndarray  # of each point: category of tie_points, or of marks counted on
    point_kinds: np.ndarray  # True where the point is a mark
    roles: np.ndarray  # of the rows of ground.csv, as asked for
    control: np.ndarray  # of each point: row of the control arrays, or -1
    control_rows: np.ndarray  # rows of ground.csv
    control_given: np.ndarray
    control_weight: np.ndarray
    gnss_image: np.ndarray
    gnss_given: np.ndarray
    gnss_weight: np.ndarray
    stack: Stack
    unknowns: list[Unknown]
    free: dict[str, tuple[str, ...]]
    arms_free: bool
    d: int
    bandwidth: int
    camera_column: np.ndarray
    slot_column: np.ndarray
    low: np.ndarray
    high: np.ndarray
    antenna_column: np.ndarray
    arm_column: np.ndarray
    ground_column: np.ndarray
    own_unknowns: list[tuple[str, int]]  # (slug, parameter) of the unknowns 6.. of an image
    prior_value: np.ndarray
    prior_weight: np.ndarray
    own_prior: np.ndarray  # (2, own unknowns): value and weight, the same for every image
    idle: np.ndarray  # (k, 2): image and unknown 6.. that nothing can determine, held at its start
    start: State
    notes: list[str] = field(default_factory=list)

    @property
    def image_count(self) -> int:
        return len(self.order)

    @property
    def shared_count(self) -> int:
        """How many unknowns images share (the border)."""
        return len(self.unknowns)

    @property
    def wide(self) -> int:
        """Columns of the border in whole panels (at least one)."""
        return max(-(-self.shared_count // PANEL), 1) * PANEL

    @property
    def observation_count(self) -> int:
        """Single numbers measured, priors among them."""
        return (
            2 * len(self.img)
            + 3 * len(self.control_rows)
            + 3 * len(self.gnss_image)
            + int(np.count_nonzero(self.prior_weight))
            + self.image_count * int(np.count_nonzero(self.own_prior[1]))
        )

    @property
    def unknown_count(self) -> int:
        """Single numbers estimated."""
        return self.image_count * self.d + 3 * len(self.ptr[1:]) + self.shared_count

    @property
    def point_names(self) -> np.ndarray:
        """Names of the points, ties and marks, in the order of the problem."""
        ties = self.block.tie_points["point"].cat.categories.to_numpy(dtype=object)
        marks = self.block.marks["point"].cat.categories.to_numpy(dtype=object)
        return np.concatenate([ties, marks])[self.point_codes]

    def values(
        self,
        state: State,
        shared_sigma: np.ndarray | None = None,
        own_sigma: np.ndarray | None = None,
    ) -> Values:
        """Values of the effects at a state, of the groups that are estimated.

        shared_sigma: of the `unknowns`. own_sigma: (images, own unknowns). What is held has the
        standard deviation 0.
        """
        out = []
        held = self.model.held
        for slug, member in self.stack.members.items():
            # Values of images are kept in the order of the problem.
            of_images = member.effect.place != "ground" and member.effect.group == "image"
            groups = [str(n) for n in (self.images.names if of_images else member.groups)]
            value, sigma = (np.full((len(groups), len(member.parameters)), np.nan) for _ in "vs")
            for k, parameter in enumerate(member.parameters):
                for g, group in enumerate(groups):
                    which = ParameterId(EFFECT, slug, parameter.name, group)
                    if any(other.means(which) for other in held):
                        value[g, k], sigma[g, k] = state.effects[slug][g, k], 0.0
            for n, (other, k) in enumerate(self.own_unknowns):
                if other == slug:
                    value[:, k] = state.effects[slug][:, k]
                    value[self.idle[self.idle[:, 1] == 6 + n, 0], k] = np.nan
                    if own_sigma is not None:
                        sigma[:, k] = own_sigma[:, n]
            for n, unknown in enumerate(self.unknowns):
                if (unknown.kind, unknown.owner) == ("effect", slug):
                    value[unknown.at] = state.effects[slug][unknown.at]
                    if shared_sigma is not None:
                        sigma[unknown.at] = shared_sigma[n]
            out.append(EffectValues(member.effect, groups, member.parameters, value, sigma))
        return Values(out)


def make_problem(block: Block, model: Model | None = None, **options) -> Problem:
    """The problem of adjusting a block whose poses and points all have start values.

    model, or options of `Model` in its place. Raises InputError for wrong input.
    """
    model = Model.of(model, **options)
    images = Images.of(block)
    roles = model.roles(block)
    control_rows = np.flatnonzero(roles == "control")
    control_names = list(block.ground["point"].to_numpy(dtype=object)[control_rows])
    stack = Stack(block, model.effects, control_names)

    ground_names = block.ground["point"].to_numpy(dtype=object)
    network = _network(block, images, set(control_names), set(ground_names[roles == "unused"]))
    order = network.order
    images = images.reordered(order)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))

    gnss_image, gnss_given, gnss_weight = _gnss(block, rank)
    arms_free = bool(len(gnss_image)) and model.arms_free(block)
    free, settings = model.free(block), model.settings
    held = model.held
    shared = free, arms_free, gnss_image
    unknowns, columns = _unknowns(images, stack, *shared, len(control_names), held)

    position = {name: n for n, name in enumerate(control_names)}
    control_of_point = np.full(len(network.codes), -1, np.int64)
    control_of_point[network.kinds] = [position.get(name, -1) for name in network.mark_names]
    # Control that no image shows adds nothing and would count as observation.
    measured = np.isin(np.arange(len(control_names)), control_of_point)
    notes = list(network.notes)
    if not measured.all():
        left = [n for n, seen in zip(control_names, measured, strict=True) if not seen]
        notes.append(
            f"Control point{'s' if len(left) > 1 else ''} {', '.join(left[:10])} "
            f"{'are' if len(left) > 1 else 'is'} not measured in any image and not used."
        )
        renumber = np.cumsum(measured) - 1
        control_of_point = np.where(control_of_point >= 0, renumber[control_of_point], -1)
        control_rows = control_rows[measured]
        control_names = [n for n, seen in zip(control_names, measured, strict=True) if seen]
        stack = Stack(block, model.effects, control_names)
        unknowns, columns = _unknowns(images, stack, *shared, len(control_names), held)

    given = block.ground[["x", "y", "z"]].to_numpy(float)[control_rows]
    sigma = block.ground_sigma()[control_rows]
    own = [
        ParameterId(EFFECT, slug, stack.members[slug].parameters[number].name)
        for slug, number in columns["own_unknowns"]
    ]
    prior_value, prior_weight, own_prior = _priors(unknowns, own, settings)
    _refuse_twice(stack, free, unknowns, prior_weight, own, own_prior)
    # An image without GNSS has nothing to say on its own antenna: that unknown rests at zero.
    silent = np.setdiff1d(np.arange(len(order)), gnss_image)
    idle = [
        (image, 6 + n)
        for n, (slug, _) in enumerate(columns["own_unknowns"])
        if stack.members[slug].effect.place == "antenna" and not own_prior[1, n]
        for image in silent
    ]

    return Problem(
        block=block,
        model=model,
        images=images,
        order=order,
        ptr=network.ptr,
        img=network.img,
        xy=network.xy,
        weight=network.weight,
        row=network.row,
        tie_count=len(block.tie_points),
        point_codes=network.codes,
        point_kinds=network.kinds,
        roles=roles,
        control=control_of_point,
        control_rows=control_rows,
        control_given=given,
        control_weight=sigma**-2.0,
        gnss_image=gnss_image,
        gnss_given=gnss_given,
        gnss_weight=gnss_weight,
        stack=stack,
        unknowns=unknowns,
        free=free,
        arms_free=arms_free,
        bandwidth=network.bandwidth,
        prior_value=prior_value,
        prior_weight=prior_weight,
        own_prior=own_prior,
        idle=np.array(idle, dtype=np.int64).reshape(-1, 2),
        start=_started(
            State(
                centre=images.centre,
                rotation=images.rotation,
                points=network.points,
                interior=np.array([c.interior for c in block.cameras.values()]),
                effects=stack.start(),
                arms=stated_lever_arms(block),
            ),
            images,
            stack,
            settings,
        ),
        notes=notes,
        **columns,
    )


def with_effects(problem: Problem, tested: Iterable[Effect]) -> Problem:
    """The same measurements with columns for effects that are tested, but for those of the antenna.

    Tested effects have no prior and may do what a free camera does: nothing is solved for them.
    Everything else stays as it was estimated, with its priors.
    """
    p, tested = problem, list(tested)
    slugs = {effect.slug for effect in tested}
    kept = [m.effect for slug, m in p.stack.members.items() if slug not in slugs]
    here = [effect for effect in tested if effect.place != "antenna"]
    control = list(p.block.ground["point"].to_numpy(dtype=object)[p.control_rows])
    stack = Stack(p.block, [*kept, *here], control)
    unknowns, columns = _unknowns(
        p.images, stack, p.free, p.arms_free, p.gnss_image, len(control), p.model.held
    )
    given = zip(p.unknowns, p.prior_value, p.prior_weight, strict=True)
    priors = {(u.kind, u.owner, u.label): prior for u, *prior in given}
    own = columns["own_unknowns"]
    of_images = dict(zip(p.own_unknowns, p.own_prior.T, strict=True))
    number = {key: 6 + n for n, key in enumerate(own)}
    idle = [(image, p.own_unknowns[n - 6]) for image, n in p.idle]
    idle = [(image, number[key]) for image, key in idle if key[0] not in slugs]
    nothing = (0.0, 0.0)
    shared_priors = [
        nothing if u.kind == "effect" and u.owner in slugs else priors[u.kind, u.owner, u.label]
        for u in unknowns
    ]
    own_priors = [nothing if key[0] in slugs else of_images[key] for key in own]
    value, weight = np.array(shared_priors, float).reshape(-1, 2).T
    return replace(
        p,
        stack=stack,
        unknowns=unknowns,
        prior_value=value,
        prior_weight=weight,
        own_prior=np.array(own_priors, float).reshape(-1, 2).T,
        idle=np.array(idle, dtype=np.int64).reshape(-1, 2),
        start=replace(p.start, effects=stack.start()),
        **columns,
    )


def _gnss(block: Block, rank: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image (k,), position (k, 3) and weight (k, 3) of the antenna positions that are known."""
    if not len(block.gnss):
        return np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3))
    given = block.gnss[["x", "y", "z"]].to_numpy(float)
    known = np.isfinite(given).all(axis=1)
    image = rank[block.image_rows("gnss")]
    return image[known], given[known], block.gnss_sigma()[known] ** -2.0


def _refuse_twice(stack: Stack, free: dict, unknowns, prior_weight, own, own_prior) -> None:
    """Refuse an effect that moves what a free camera parameter moves, unless a prior holds it."""
    estimated = {(camera, name) for camera, names in free.items() for name in names}
    for slug, member in stack.members.items():
        doubled = [pair for pair in estimated if pair[1] in member.effect.stands_in_for]
        shared = [n for n, u in enumerate(unknowns) if (u.kind, u.owner) == ("effect", slug)]
        mine = [n for n, which in enumerate(own) if which.owner == slug]
        if doubled and not (prior_weight[shared].all() and own_prior[1, mine].all()):
            camera, _ = min(doubled)
            names = ", ".join(n for n in free[camera] if n in member.effect.stands_in_for)
            raise InputError(
                f"effect {slug} does to the picture what {names} of camera {camera}, which "
                f"{'is' if ',' not in names else 'are'} estimated, can do: hold the camera "
                "(fixed, or a list without them), give the effect a prior, or leave it out"
            )


@dataclass
class _Network:
    order: np.ndarray
    ptr: np.ndarray
    img: np.ndarray
    xy: np.ndarray
    weight: np.ndarray
    row: np.ndarray
    codes: np.ndarray
    kinds: np.ndarray
    mark_names: np.ndarray  # of the points that are marks
    points: np.ndarray
    bandwidth: int
    notes: list[str]


def _network(block: Block, images: Images, control: set[str], unused: set[str]) -> _Network:
    """Observations sorted by point and image, points by their images, images by place."""
    tie, mark = block.tie_points, block.marks
    tie_names = tie["point"].cat.categories
    mark_names = mark["point"].cat.categories
    codes = [
        rows["point"].cat.codes.to_numpy().astype(np.int32, copy=False) for rows in (tie, mark)
    ]
    point = _joined(codes[0], codes[1] + np.int32(len(tie_names)))
    image = _joined(
        block.image_rows("tie_points").astype(np.int32), block.image_rows("marks").astype(np.int32)
    )
    del codes
    count = len(tie_names) + len(mark_names)
    xyz = np.concatenate([block.positions("tie_points"), block.positions("marks")])
    skip = np.zeros(count, dtype=bool)
    skip[len(tie_names) :] = [name in unused for name in mark_names]
    rays = np.bincount(point, minlength=count)
    _check_rays(block, rays, control, tie_names, mark_names, skip)
    keep = None
    if skip.any():
        keep = np.flatnonzero(~skip[point])
        point, image = point[keep], image[keep]
        rays[skip] = 0
    _check_images(block, image, images)

    order = corridor_order(point, image, xyz, images)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order))
    at = rank[image]
    del image
    first = np.full(count, len(order), dtype=np.int32)
    np.minimum.at(first, point, at)
    # Points that the same images see belong together: the kernel gathers them.
    same = np.bincount(point, at.astype(float) ** 2, minlength=count)
    by_first = np.lexsort((same, first))
    number = np.empty(count, dtype=np.int64)
    number[by_first] = np.arange(count)
    key = number[point]
    del point
    key *= len(order)
    key += at
    sort = np.argsort(key, kind="stable")
    del key
    img = at[sort]
    row = sort.astype(np.int32) if keep is None else keep[sort].astype(np.int32)
    del at, sort, keep
    used = rays[by_first] > 0
    codes = by_first[used]
    ptr = np.concatenate([[0], np.cumsum(rays[codes])])
    xy = np.empty((len(row), 2))
    for k, axis in enumerate("xy"):
        xy[:, k] = _joined(tie[axis].to_numpy(float), mark[axis].to_numpy(float))[row]
    weight = 1.0 / _joined(block.tie_sigma(), block.mark_sigma())[row]
    if len(weight) and np.all(weight == weight[0]):
        weight = weight[:1].copy()
    kinds = codes >= len(tie_names)
    return _Network(
        order=order,
        ptr=ptr,
        img=img,
        xy=xy,
        weight=weight,
        row=row,
        codes=codes,
        kinds=kinds,
        mark_names=mark_names.to_numpy(object)[codes[kinds] - len(tie_names)],
        points=np.ascontiguousarray(xyz[codes]),
        bandwidth=bandwidth(ptr, img),
        notes=[],
    )


def _joined(ties: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Ties, then marks; not copied where there are no marks."""
    return np.concatenate([ties, marks]) if len(marks) else ties


def _check_rays(block, rays, control, tie_names, mark_names, skip) -> None:
    """Refuse points that one image alone shows, unless their coordinates are given."""
    single = (rays == 1) & ~skip
    for table, names, offset in (
        ("tie_points", tie_names, 0),
        ("marks", mark_names, len(tie_names)),
    ):
        alone = np.flatnonzero(single[offset : offset + len(names)])
        if table == "marks":
            alone = np.array([n for n in alone if names[n] not in control], dtype=int)
        if len(alone) == 0:
            continue
        row = np.flatnonzero(np.isin(getattr(block, table)["point"].cat.codes, alone))[0]
        name = getattr(block, table)["point"].iloc[row]
        more = f" ({len(alone) - 1} more points too)" if len(alone) > 1 else ""
        raise InputError(
            f"{block.where(table, row)}: point {name} is seen in one image only{more}: measure it "
            "in a second image or remove the row"
        )


def _check_images(block: Block, image: np.ndarray, images: Images) -> None:
    """Refuse images with too few points to have a pose."""
    count = np.bincount(image, minlength=len(images.names))
    few = np.flatnonzero(count < 3)
    if len(few):
        more = f" ({len(few) - 1} more images have too few)" if len(few) > 1 else ""
        raise InputError(
            f"{block.where('images', few[0])}: image {images.names[few[0]]} has {count[few[0]]} "
            f"measured points, a pose needs 3{more}: measure more or remove the image"
        )


def _unknowns(images, stack, free, arms_free, gnss_image, controls, held=()):
    """The border's unknowns, and which columns each image, antenna and control point touches.

    held: parameters of effects and lever arms that are not to vary.
    """
    unknowns: list[Unknown] = []
    count = len(images.names)
    wanted = [name for name in INTERIOR if any(name in f for f in free.values())]
    index = {}
    for c, name in enumerate(images.camera_names):
        for parameter in wanted:
            if parameter in free[name] and (images.camera == c).any():
                index[c, parameter] = len(unknowns)
                at = (c, INTERIOR.index(parameter))
                unit = "px" if parameter in ("f", "cx", "cy") else ""
                unknowns.append(Unknown(CAMERA, name, parameter, unit=unit, at=at))
    camera_column = np.full((count, len(INTERIOR)), -1)
    for (c, parameter), column in index.items():
        camera_column[images.camera == c, INTERIOR.index(parameter)] = column

    own: list[tuple[str, int]] = []
    places: dict[str, list[np.ndarray]] = {p: [] for p in ("camera", "image", "motion", "antenna")}
    ground: list[np.ndarray] = []
    in_gnss = np.zeros(count, dtype=bool)
    in_gnss[gnss_image] = True
    for place in (*places, "ground"):
        for member in stack.at(place):
            kind, slug = member.effect.group, member.effect.slug
            if place == "ground":
                groups = member.groups
            else:
                groups = group_names(images, kind)
                of_image = group_of_image(images, kind)
            for number, parameter in enumerate(member.parameters):
                which = ParameterId(EFFECT, slug, parameter.name)
                if place != "ground" and kind == "image":
                    if any(other.means(which) for other in held):
                        places[place].append(np.full(count, -1))
                        continue
                    places[place].append(np.full(count, -2 - len(own)))
                    own.append((slug, number))
                    continue
                column = np.full(len(groups), -1)
                for g, group in enumerate(groups):
                    here = in_gnss if place == "antenna" else np.ones(count, dtype=bool)
                    if place != "ground" and not (here & (of_image == g)).any():
                        continue
                    which = ParameterId(EFFECT, slug, parameter.name, group)
                    if any(other.means(which) for other in held):
                        continue
                    column[g] = len(unknowns)
                    unknowns.append(
                        Unknown(EFFECT, slug, parameter.name, group, parameter.unit, (g, number))
                    )
                if place == "ground":
                    ground.append(column)
                else:
                    places[place].append(column[of_image])
    arm_column = np.full((count, 3), -1)
    if arms_free:
        for g, flight in enumerate(images.flight_names):
            mine = images.flight == g
            if not (mine & in_gnss).any():
                continue
            for axis, name in enumerate("xyz"):
                if ParameterId(LEVER_ARM, flight, name) in held:
                    continue
                arm_column[mine, axis] = len(unknowns)
                unknowns.append(Unknown(LEVER_ARM, flight, name, unit="m", at=(g, axis)))

    def stacked(parts, rows):
        return np.stack(parts, 1).astype(np.int64) if parts else np.zeros((rows, 0), np.int64)

    slot_column = stacked(places["camera"] + places["image"] + places["motion"], count)
    touched = np.concatenate([camera_column, slot_column], axis=1)
    high = touched.max(axis=1, initial=-1) + 1
    low = np.where(touched >= 0, touched, np.iinfo(np.int64).max).min(axis=1)
    # Whole panels, as the kernels take them; nothing at all where no column is touched.
    low = np.where(high > 0, low // PANEL * PANEL, 0)
    high = -(-high // PANEL) * PANEL

    return unknowns, {
        "d": 6 + len(own),
        "own_unknowns": own,
        "camera_column": camera_column,
        "slot_column": slot_column,
        "low": low,
        "high": high,
        "antenna_column": stacked(places["antenna"], count),
        "arm_column": arm_column,
        "ground_column": stacked([np.broadcast_to(c, controls) for c in ground], controls),
    }


def _priors(
    unknowns: list[Unknown], own: list[ParameterId], settings: Mapping[ParameterId, Setting]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Prior value and weight (0: none) of the border's unknowns and of those of every image."""
    value, weight = np.zeros(len(unknowns)), np.zeros(len(unknowns))
    of_images = np.zeros((2, len(own)))
    for which, wish in settings.items():
        if wish.prior is None:
            continue
        hit = [n for n, unknown in enumerate(unknowns) if which.means(unknown)]
        mine = [n for n, other in enumerate(own) if which == other]
        if not hit and not mine:
            names = [str(unknown) for unknown in (*unknowns, *own)]
            raise InputError(
                f"prior {which}: nothing of that name is estimated; estimated are "
                f"{', '.join(names) or 'poses and points only'}"
            )
        mean, sigma = wish.prior
        if not (np.isfinite(mean) and np.isfinite(sigma) and sigma > 0):
            raise InputError(f"prior {which}: its standard deviation must be a positive number")
        value[hit], weight[hit] = mean, sigma**-2.0
        of_images[:, mine] = [[mean], [sigma**-2.0]]
    return value, weight, of_images


def _started(
    state: State, images: Images, stack: Stack, settings: Mapping[ParameterId, Setting]
) -> State:
    """The state with the values that somebody wants parameters to start from."""
    for which, wish in settings.items():
        if wish.value is None and wish.vary is None:
            continue
        cells = _cells_of(which, state, images, stack)
        if not cells:
            raise InputError(f"parameter {which}: the model has none of that name")
        for table, at in cells if wish.value is not None else ():
            table[at] = wish.value
    return state


def _cells_of(which: ParameterId, state: State, images: Images, stack: Stack) -> list:
    """Arrays of a state and the places in them where a parameter has its values."""
    if which.kind == CAMERA and which.owner in images.camera_names and which.name in INTERIOR:
        return [
            (state.interior, (images.camera_names.index(which.owner), INTERIOR.index(which.name)))
        ]
    if which.kind == LEVER_ARM and which.owner in images.flight_names and which.name in "xyz":
        return [(state.arms, (images.flight_names.index(which.owner), "xyz".index(which.name)))]
    member = stack.members.get(which.owner)
    names = [p.name for p in member.parameters] if member else []
    if which.kind != EFFECT or which.name not in names:
        return []
    of_images = member.effect.place != "ground" and member.effect.group == "image"
    groups = list(images.names) if of_images else member.groups
    return [
        (state.effects[which.owner], (g, names.index(which.name)))
        for g, group in enumerate(groups)
        if which.group in ("block", group)
    ]
