"""The list of what is estimated, where it stands in the equations, and what is known of it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from corridor.core.adjustment.model import CAMERA, EFFECT, LEVER_ARM, ParameterId, Setting
from corridor.core.brief import brief
from corridor.core.camera import INTERIOR
from corridor.core.effects import Arrays, Context, Images, Member, Stack, group_of_image
from corridor.core.errors import InputError

# Interior parameters that are lengths in the picture; the others have no unit.
IN_PIXELS = ("f", "cx", "cy")


@dataclass(frozen=True)
class Unknown(ParameterId):
    """One unknown that images share. at: where its value lives (row, column of its table)."""

    unit: str = ""
    at: tuple[int, int] = (0, 0)

    @property
    def label(self) -> str:
        """Public name: `camera.P1.f`, `rolling_shutter.readout`, `lever_arm.F1.z`."""
        return str(self)


@brief
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


def is_per_image(column: np.ndarray) -> np.ndarray:
    """Where the code of a column stands for an unknown that an image has for itself."""
    return column <= -2


def per_image_code(number):
    """Code of a column from the number (6..) of an image's own unknown, and that from the code."""
    return 4 - number


@dataclass
class Unknowns:
    """What images share, what each image has beside its pose, and the columns of both.

    per_image_unknowns: (slug, parameter) of the unknowns 6.. of an image, which are d in all.
    Columns of an image (m, ...): >= 0 shared, -1 none, `is_per_image` its own; camera_column by
    interior parameter, slot_column by parameter of effects on camera, image and motion,
    antenna_column of effects on the antenna, attitude_column of those on attitudes, arm_column
    (m, 3); ground_column (c, ...) of a control point, distance_column (k, ...) of a distance.
    """

    unknowns: list[Unknown]
    per_image_unknowns: list[tuple[str, int]]
    d: int
    camera_column: np.ndarray
    slot_column: np.ndarray
    antenna_column: np.ndarray
    attitude_column: np.ndarray
    arm_column: np.ndarray
    ground_column: np.ndarray
    distance_column: np.ndarray


@dataclass
class Priors:
    """Prior value and weight (0: none) of the shared unknowns, and of those of every image.

    per_image_prior (2, images, own unknowns): value and weight.
    """

    prior_value: np.ndarray
    prior_weight: np.ndarray
    per_image_prior: np.ndarray


@dataclass
class Wanted:
    """What is to be estimated beside poses, points and effects.

    free: interior parameters of each camera. arms_free: the lever arms. measured: images (k,) with
    a position, place `antenna`, or an attitude. controls: names of the control points. distances:
    rows (k,) of distances.csv that count. held: parameters of effects and lever arms that are not
    to vary.
    """

    free: Mapping[str, tuple[str, ...]]
    arms_free: bool
    measured: Mapping[str, np.ndarray]
    controls: list[str]
    distances: np.ndarray
    held: list[ParameterId]

    def holds(self, which: ParameterId) -> bool:
        """Whether a parameter is not to vary."""
        return any(other.means(which) for other in self.held)


def unknowns_of(images: Images, stack: Stack, wanted: Wanted) -> Unknowns:
    """The unknowns that images share, and which columns each image and control point touches."""
    shared: list[Unknown] = []
    own: list[tuple[str, int]] = []
    count = len(images.names)
    among = {place: np.isin(np.arange(count), some) for place, some in wanted.measured.items()}
    in_gnss = among["antenna"]
    camera_column = _camera_columns(images, wanted.free, shared)

    def effects(places: tuple[str, ...], rows: np.ndarray | Context) -> np.ndarray:
        """Columns (rows, parameters) of the effects at places, in which `rows` are moved.

        rows: of the images, whether they are; or the control points, or distances.
        """
        members = [member for place in places for member in stack.at(place)]
        found = [_columns_of(images, member, rows, wanted, shared, own) for member in members]
        size = len(rows)
        return np.concatenate([np.zeros((size, 0), np.int64), *found], axis=1)

    slot_column = effects(("camera", "image", "motion"), np.ones(count, bool))
    antenna_column = effects(("antenna",), in_gnss)
    attitude_column = effects(("attitude",), among["attitude"])
    ground_column = effects(("ground",), Context(images, point=wanted.controls))
    distance_column = effects(("distance",), Context(images, distance=wanted.distances))
    arm_column = np.full((count, 3), -1)
    if wanted.arms_free:
        for g, flight in enumerate(images.flight_names):
            mine = images.flight == g
            for axis, name in enumerate("xyz") if (mine & in_gnss).any() else ():
                if not wanted.holds(ParameterId(LEVER_ARM, flight, name)):
                    arm_column[mine, axis] = len(shared)
                    shared.append(Unknown(LEVER_ARM, flight, name, unit="m", at=(g, axis)))
    return Unknowns(
        unknowns=shared,
        per_image_unknowns=own,
        d=6 + len(own),
        camera_column=camera_column,
        slot_column=slot_column,
        antenna_column=antenna_column,
        attitude_column=attitude_column,
        arm_column=arm_column,
        ground_column=ground_column,
        distance_column=distance_column,
    )


def _camera_columns(images: Images, free: Mapping, shared: list[Unknown]) -> np.ndarray:
    """Columns (images, interior parameters); what is free is added to shared."""
    out = np.full((len(images.names), len(INTERIOR)), -1)
    for c, name in enumerate(images.camera_names):
        mine = images.camera == c
        for k, parameter in enumerate(INTERIOR):
            if parameter in free[name] and mine.any():
                out[mine, k] = len(shared)
                unit = "px" if parameter in IN_PIXELS else ""
                shared.append(Unknown(CAMERA, name, parameter, unit=unit, at=(c, k)))
    return out


def _columns_of(
    images: Images,
    member: Member,
    rows: np.ndarray | Context,
    wanted: Wanted,
    shared: list[Unknown],
    own: list[tuple[str, int]],
) -> np.ndarray:
    """Columns (rows, parameters) of an effect; what is estimated is added to shared and own."""
    effect, names = member.effect, member.groups
    if isinstance(rows, Context):
        of_row = rows.group(effect.group)
        moved = set(of_row.tolist())
    else:
        of_row = group_of_image(images, effect.group)
        moved = set(of_row[rows].tolist())
    out = np.full((len(of_row), len(member.parameters)), -1, np.int64)
    if effect.group == "image":
        for number, parameter in enumerate(member.parameters):
            if not wanted.holds(ParameterId(EFFECT, effect.slug, parameter.name)):
                out[:, number] = per_image_code(6 + len(own))
                own.append((effect.slug, number))
        return out
    # Columns of one group stand together: an image has no others.
    column = np.full((len(names) + 1, len(member.parameters)), -1)
    for g, group in enumerate(names):
        for number, parameter in enumerate(member.parameters):
            one = Unknown(EFFECT, effect.slug, parameter.name, group, parameter.unit, (g, number))
            if g in moved and not wanted.holds(one):
                column[g, number] = len(shared)
                shared.append(one)
    out[:] = column[np.where(of_row >= 0, of_row, len(names))]
    return out


def per_image_names(stack: Stack, own: list[tuple[str, int]]) -> list[ParameterId]:
    """Names of the unknowns that each image has beside its pose."""
    return [
        ParameterId(EFFECT, slug, stack.members[slug].parameters[number].name)
        for slug, number in own
    ]


def priors_of(
    unknowns: list[Unknown],
    own: list[ParameterId],
    settings: Mapping[ParameterId, Setting],
    images: int,
) -> Priors:
    """Prior value and weight (0: none) of the border's unknowns and of those of every image."""
    value, weight = np.zeros(len(unknowns)), np.zeros(len(unknowns))
    of_images = np.zeros((2, images, len(own)))
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
        of_images[0][:, mine], of_images[1][:, mine] = mean, sigma**-2.0
    return Priors(value, weight, of_images)


def refuse_twice(
    stack: Stack, free: Mapping, unknowns: list[Unknown], own: list[ParameterId], priors: Priors
) -> None:
    """Refuse an effect that moves what a free camera parameter moves, unless a prior holds it."""
    estimated = {(camera, name) for camera, names in free.items() for name in names}
    for slug, member in stack.members.items():
        doubled = [pair for pair in estimated if pair[1] in member.effect.stands_in_for]
        shared = [n for n, u in enumerate(unknowns) if (u.kind, u.owner) == ("effect", slug)]
        mine = [n for n, which in enumerate(own) if which.owner == slug]
        held = priors.prior_weight[shared].all() and priors.per_image_prior[1][:, mine].all()
        if doubled and not held:
            camera, _ = min(doubled)
            names = ", ".join(n for n in free[camera] if n in member.effect.stands_in_for)
            raise InputError(
                f"effect {slug} does to the picture what {names} of camera {camera}, which "
                f"{'is' if ',' not in names else 'are'} estimated, can do: hold the camera "
                "(fixed, or a list without them), give the effect a prior, or leave it out"
            )


def started(
    state: State, images: Images, stack: Stack, settings: Mapping[ParameterId, Setting]
) -> State:
    """The state with the values that somebody wants parameters to start from."""
    for which, wish in settings.items():
        if wish.value is None and wish.vary is None:
            continue
        cells = _cells_of(which, state, images, stack)
        if not cells:
            raise InputError(f"parameter {which}: the model has no parameter of that name")
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
    if member is None or which.kind != EFFECT or which.name not in names:
        return []
    of_images = member.effect.place != "ground" and member.effect.group == "image"
    groups = list(images.names) if of_images else member.groups
    return [
        (state.effects[which.owner], (g, names.index(which.name)))
        for g, group in enumerate(groups)
        if which.group in ("block", group)
    ]
