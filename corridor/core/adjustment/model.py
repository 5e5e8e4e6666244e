"""What is estimated: the model of an adjustment, and the names of its parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from corridor.core.adjustment.uncertain_motion import MotionScale
from corridor.core.block import Block
from corridor.core.camera import INTERIOR, parameters_named
from corridor.core.effects import Effect, find
from corridor.core.engine.scene import CAUCHY, HUBER, SQUARES
from corridor.core.errors import InputError

# Free parameters of a camera that is not calibrated, where nobody says which: two sets, because two
# questions are asked. An adjustment measures. It frees what other programs free and published
# results have; free affinity would take up a good part of a rolling shutter along straight strips,
# which otherwise shows in the residuals and in sigma naught.
DEFAULT_CAMERA = "fraser8"
# A diagnosis tests. Affinity is a candidate only where the camera is held, so beside a free camera
# it is free as well: what a camera can take must not be told as an effect.
REFERENCE_CAMERA = "fraser10"
LOSSES = {"squares": SQUARES, "huber": HUBER, "cauchy": CAUCHY}
# What is not an effect: interior parameters of a camera, the antenna's place in a flight.
CAMERA, LEVER_ARM, EFFECT = "camera", "lever_arm", "effect"
# Key of a camera in block.toml: what its photographs state of f, value and standard deviation, px.
STATED_FOCAL = "f_stated"
# A drone carries its antenna within some decimetres of the camera: positions coarser than this in
# plan say nothing of it, and one that is estimated from them is other errors by another name.
SEES_ARM_M = 0.2


class Loss(NamedTuple):
    """A loss function on the length of an image residual in sigmas."""

    kind: int = SQUARES
    width: float = 2.0

    @classmethod
    def parse(cls, text: str) -> Loss:
        """From `squares`, `huber:2`, `cauchy:2`. Raises InputError for one that is unknown."""
        kind, _, width = text.partition(":")
        try:
            loss = cls(LOSSES[kind], float(width or 2.0))
        except (KeyError, ValueError):
            loss = cls(width=0.0)
        if not loss.width > 0 or not np.isfinite(loss.width):
            raise InputError(f"loss {text!r} is unknown: use squares, huber:2 or cauchy:2")
        return loss


@dataclass(frozen=True)
class ParameterId:
    """Which parameter is meant: `camera.P1.f`, `lever_arm.F1.z`, `gnss_bias.F1.x`, `focal.f`.

    kind: `camera`, `lever_arm` or `effect`. owner: camera, flight or slug. group: of an effect, a
    flight, camera or point; `block` where all have one value. name: of the parameter.
    """

    kind: str
    owner: str
    name: str
    group: str = "block"

    def __str__(self) -> str:
        kind = "" if self.kind == EFFECT else self.kind
        group = "" if self.group == "block" else self.group
        return ".".join(part for part in (kind, self.owner, group, self.name) if part)

    @classmethod
    def parse(cls, text: str) -> ParameterId:
        """The parameter that a name means; of a slug alone, the name is empty.

        `lever_arm` is a kind and the slug of an effect: with a flight it is the kind.
        """
        owner, *group, name = text.split(".") if "." in text else (text, "")
        if owner in (CAMERA, LEVER_ARM) and group:
            return cls(owner, ".".join(group), name)
        return cls(EFFECT, owner, name, ".".join(group) or "block")

    def means(self, other: ParameterId) -> bool:
        """Whether this name means another parameter; an effect's group may be left out."""
        # By its name alone, a flight's lever arm may be that of the effect `lever_arm@flight`.
        if str(self) == str(other):
            return True
        same = (self.kind, self.owner, self.name) == (other.kind, other.owner, other.name)
        return same and self.kind == EFFECT and self.group == "block"


@dataclass
class Setting:
    """What a person wants of one parameter; None: as the model has it.

    value: where it starts, and stays where it is not to vary. prior: value and standard deviation.
    """

    value: float | None = None
    vary: bool | None = None
    prior: tuple[float, float] | None = None


class ParameterSettings(dict):
    """Settings by the names of parameters; one that is asked for first is as the model has it."""

    def __missing__(self, name: str) -> Setting:
        self[name] = Setting()
        return self[name]


@dataclass
class Model:
    """What is estimated, and what is known of it beforehand.

    camera: free interior parameters, `fixed`, `fraser8`, `fraser10`, `f,cx,cy,k1` or a list of
        names; a mapping gives each camera its own. Default: eight, and k4 of a fisheye, or none
        where the camera is calibrated.
    effects: slugs of effects to estimate with the rest (`slug@flight` for one set a flight), or
        effects; one alone needs no list.
    control, check: ground points with that role, in place of the roles in ground.csv: names, or
        one text with commas between them.
    priors: value and standard deviation by name: `{"camera.P1.f": (8190.0, 5.0)}`.
    lever_arm: `free` or `fixed`; default: free unless block.toml fixes it or the GNSS positions
        are too coarse to see it.
    loss: `squares`, `huber:2` or `cauchy:2`, on the length of an image residual in sigmas.
    parameters: what is wanted of single ones: `model.parameters["camera.P1.k3"].vary = False`.
    motion: by what deviations of velocities and of angular rates count while an image is read (a
        `MotionScale`); None: what the adjustment finds.
    """

    camera: str | Iterable[str] | Mapping[str, str] | None = None
    effects: str | Effect | Iterable[str | Effect] = ()
    control: str | Iterable[str] | None = None
    check: str | Iterable[str] | None = None
    priors: Mapping[str, tuple[float, float]] | None = None
    lever_arm: str | None = None
    loss: str = "squares"
    parameters: ParameterSettings = field(default_factory=ParameterSettings)
    motion: MotionScale | None = None

    def __post_init__(self):
        if isinstance(self.camera, Mapping):
            self.camera = {name: _joined(free) for name, free in self.camera.items()}
        elif self.camera is not None:
            self.camera = _joined(self.camera)
        self.effects = listed_effects(self.effects)
        self.control = None if self.control is None else listed(self.control)
        self.check = None if self.check is None else listed(self.check)
        self.priors = dict(self.priors or {})
        for name, prior in self.priors.items():
            if np.shape(prior) != (2,):
                raise InputError(
                    f"prior {name} is {prior!r}: give a value and its standard deviation, as in "
                    f"{{{name!r}: (8190.0, 5.0)}}"
                )
        if not isinstance(self.parameters, ParameterSettings):
            self.parameters = ParameterSettings(self.parameters)
        if self.lever_arm not in (None, "free", "fixed"):
            raise InputError(f"lever arm {self.lever_arm!r} is unknown: use free or fixed")
        Loss.parse(self.loss)

    def settings_of(self, block: Block) -> dict[ParameterId, Setting]:
        """Wishes for single parameters, and the stated focal lengths of cameras that are free.

        Raises InputError where block.toml states one that is no value and standard deviation.
        """
        out, free = self.settings, self.free(block)
        for name, camera in block.cameras.items():
            stated = camera.extra.get(STATED_FOCAL)
            if stated is None or "f" not in free[name]:
                continue
            if np.shape(stated) != (2,) or not all(_is_size(number) for number in stated):
                raise InputError(
                    f"block.toml: {STATED_FOCAL} of camera {name} is {stated!r}: write a focal "
                    "length and its standard deviation in px, as [1133.0, 34.0]"
                )
            wish = out.setdefault(ParameterId(CAMERA, name, "f"), Setting())
            wish.prior = wish.prior or (float(stated[0]), float(stated[1]))
        return out

    @property
    def settings(self) -> dict[ParameterId, Setting]:
        """Wishes for single parameters, `priors` among them."""
        out = {
            ParameterId.parse(name): Setting(prior=prior)
            for name, prior in (self.priors or {}).items()
        }
        for name, wish in self.parameters.items():
            mine = out.setdefault(ParameterId.parse(name), Setting())
            mine.value, mine.vary = wish.value, wish.vary
            mine.prior = wish.prior or mine.prior
        return out

    @property
    def held(self) -> list[ParameterId]:
        """Parameters that are not to vary."""
        return [which for which, wish in self.settings.items() if wish.vary is False]

    def with_priors(self, priors: Mapping[str, tuple[float, float]]) -> Model:
        """The same model with these priors and no others."""
        wishes = {name: replace(wish, prior=None) for name, wish in self.parameters.items()}
        return replace(self, priors=priors, parameters=ParameterSettings(wishes))

    def starting(self, values: Mapping[str, float]) -> Model:
        """The same model with these start values, but of parameters that are not to vary."""
        wishes = dict(self.parameters)
        for name, value in values.items():
            wish = wishes.get(name, Setting())
            wishes[name] = wish if wish.vary is False else replace(wish, value=value)
        return replace(self, parameters=ParameterSettings(wishes))

    def without_effects(self) -> Model:
        """The same model without its effects, and without what is wanted of their parameters."""

        def others(names: Mapping) -> dict:
            return {k: v for k, v in names.items() if ParameterId.parse(k).kind != EFFECT}

        return replace(
            self,
            effects=(),
            priors=others(self.priors or {}),
            parameters=ParameterSettings(others(self.parameters)),
        )

    def free(self, block: Block) -> dict[str, tuple[str, ...]]:
        """Free interior parameters of each camera. Raises InputError for an unknown camera."""
        wanted = self.camera if self.camera is not None else camera_of(block, DEFAULT_CAMERA)
        if isinstance(wanted, Mapping):
            unknown = [name for name in wanted if name not in block.cameras]
            if unknown:
                raise InputError(
                    f"block.toml has no camera {', '.join(unknown)}: it has "
                    f"{', '.join(block.cameras)}"
                )
        else:
            wanted = dict.fromkeys(block.cameras, _joined(wanted))
        out = {name: list(parameters_named(wanted.get(name, "fixed"))) for name in block.cameras}
        for which, wish in self.settings.items():
            if which.kind == CAMERA and wish.vary is not None and which.owner in out:
                if which.name not in INTERIOR:
                    raise InputError(
                        f"camera {which.owner} has no parameter {which.name}: it has "
                        f"{', '.join(INTERIOR)}"
                    )
                others = [name for name in out[which.owner] if name != which.name]
                out[which.owner] = [*others, which.name] if wish.vary else others
        return {name: tuple(names) for name, names in out.items()}

    def arms_free(self, block: Block) -> bool:
        """Whether the lever arms of the flights are estimated."""
        if self.lever_arm is None:
            return not block.lever_arm_fixed and not arms_unseen(block)
        return self.lever_arm == "free"

    def roles(self, block: Block) -> np.ndarray:
        """Role of each row of ground.csv after control and check have had their say.

        Raises InputError for a point that ground.csv does not have, or that is to be both.
        """
        roles = block.ground["role"].to_numpy(dtype=object).copy()
        names = block.ground["point"].to_numpy(dtype=object)
        for given, role in ((self.control, "control"), (self.check, "check")):
            if given is None:
                continue
            unknown = [name for name in given if name not in set(names)]
            if unknown:
                raise InputError(
                    f"ground.csv has no point {', '.join(unknown)}, which is to be a {role} point: "
                    f"it has {', '.join(names[:20]) or 'none'}"
                )
            chosen = np.isin(names, listed(given))
            # Who names the control points means that the others check, and the other way round.
            other = "check" if role == "control" else "control"
            if role == "control" or self.control is None:
                roles[(roles == role) & ~chosen] = other if role == "control" else "unused"
            roles[chosen] = role
        both = set(self.control or ()) & set(self.check or ())
        if both:
            raise InputError(f"{', '.join(sorted(both))} cannot be control and check point at once")
        return roles


def arms_unseen(block: Block) -> bool:
    """Whether the antenna positions of all flights are too coarse to see where on a drone the
    antenna sits."""
    sigma = block.gnss_sigma()[:, :2]
    flight = block.image_flight[block.image_rows("gnss")]
    medians = [float(np.median(sigma[flight == one])) for one in np.unique(flight)]
    return bool(medians) and min(medians) > SEES_ARM_M


def _is_size(number) -> bool:
    return isinstance(number, int | float) and np.isfinite(number) and number > 0


def listed(names: str | Iterable) -> list:
    """Names as a list; of a text, what its commas part."""
    if isinstance(names, str):
        return [name.strip() for name in names.split(",") if name.strip()]
    return list(names)


def listed_effects(effects: str | Effect | Iterable[str | Effect]) -> list[Effect]:
    """Effects as a list, those that a slug names found; of one alone, that one."""
    given = [effects] if isinstance(effects, Effect) else listed(effects)
    return [effect if isinstance(effect, Effect) else find(effect) for effect in given]


def _joined(free: str | Iterable[str]) -> str:
    return free if isinstance(free, str) else ",".join(free) or "fixed"


def camera_of(block: Block, free: str) -> dict[str, str]:
    """The same free parameters for each camera, with k4 of a fisheye; none where calibrated."""
    free_of = {False: free, True: ",".join({**dict.fromkeys(parameters_named(free)), "k4": None})}
    return {n: "fixed" if c.calibrated else free_of[c.fisheye] for n, c in block.cameras.items()}
