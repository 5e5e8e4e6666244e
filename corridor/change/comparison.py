"""How two dates are compared: everything that may be asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from corridor.adjustment import listed
from corridor.change.stable import MOTIONS
from corridor.errors import InputError

DEGREES = (0, 1, 2)
DATUMS = ("stated", "stable")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What is asked of two dates.

    common: errors that both epochs share, of `control` (the same coordinates of a control point in
        both), `priors` (the same value known beforehand), `gnss` (the base station's).
    gnss_bias: standard deviation, m (one number or three), of a constant error of the GNSS.
    datum: `stated`: as each epoch's control and GNSS say; `stable`: laid together on what stands
        still by a motion: `translation`, `rigid`, `similarity`. Default: `stable` where an epoch
        hangs on GNSS of metres alone, else `stated`.
    level: false discovery rate of single tests, level of the global ones.
    surface: whether surfaces are compared. camera: whether effects of the camera are asked for.
    together: both dates in one adjustment. stable: ground points that stand still, one point
        there (default: those that do as far as can be seen). same_camera: one calibration.
    largest: m, displacement of a named point beyond which the name means something else.

    Of the surface:

    spacing: of the core points, m (default: half the radius). radius: of the cylinder in which
        points count, m (default: so that it holds some 15). normal: `local` or `vertical`.
    degree: 0 the mean of the points (M3C2), 1 a plane, 2 with curvature.
    profile (n, 2): core points along this line instead of a grid. polygons: name -> (n, 2), m, for
        volumes.
    rays: images that must show a tie point. same_ties: a tie point of one name is one point of the
        ground.

    Raises InputError for a value that means nothing.
    """

    common: str | Iterable[str] = ("control", "priors")
    gnss_bias: float | Iterable[float] | None = None
    datum: str | None = None
    motion: str = "rigid"
    level: float = 0.01
    surface: bool = True
    camera: bool = True
    together: bool = False
    stable: str | Iterable[str] | None = None
    same_camera: bool = False
    largest: float = 5.0
    spacing: float | None = None
    radius: float | None = None
    normal: str = "local"
    degree: int = 0
    profile: np.ndarray | None = None
    polygons: Mapping[str, np.ndarray] | None = None
    rays: int = 3
    same_ties: bool = False

    def __post_init__(self):
        # A text, and what can be walked through once, are names too, whenever they are asked for.
        object.__setattr__(self, "common", tuple(listed(self.common)))
        if self.stable is not None:
            object.__setattr__(self, "stable", tuple(listed(self.stable)))
        if self.datum is not None and self.datum not in DATUMS:
            raise InputError(f"datum {self.datum!r} is unknown: use {' or '.join(DATUMS)}")
        if self.motion not in MOTIONS:
            raise InputError(f"motion {self.motion!r} is unknown: use one of {', '.join(MOTIONS)}")
        if not 0 < self.level < 1:
            raise InputError(f"level {self.level} is no probability between 0 and 1")
        if self.degree not in DEGREES:
            raise InputError(
                f"a surface of degree {self.degree} is unknown: use 0 (the mean), 1 (a plane) or 2"
            )
        if not self.together and (self.same_camera or self.stable is not None):
            what = "one calibration for both dates (--same-camera)"
            what = what if self.same_camera else "points that stand still (--stable)"
            raise InputError(f"{what}: it goes with both dates in one adjustment, add --together")

    @property
    def bias(self) -> np.ndarray | None:
        """Standard deviations (3,), m, of a constant error of the GNSS; None: nobody states one."""
        if self.gnss_bias is None:
            return None
        return np.broadcast_to(np.asarray(self.gnss_bias, float), 3)
