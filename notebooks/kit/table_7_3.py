"""The two-step correction (adjust blind, find velocities, take the shutter out, adjust again), and
one survey in every configuration of Zhou 2019, table 7.3, and with a motion of each image."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import correct
from corridor.core.preparation import Velocities, velocities

CAMERAS = {"8p": "fraser8", "10p": "fraser10"}
CORRECTED = {"c": "neighbours"}


def _program(original, gains, cameras=("8p", "10p")):
    """3D RMS of `o` and `c` by configuration; of `c` as the printed gain says.

    The printed columns of the corrected observations are not all legible; the gains are.
    """
    names = [f"{camera}-GCP{number}" for camera in cameras for number in (1, 2)]
    rows = {f"o-{name}": value for name, value in zip(names, original, strict=True)}
    for name, value, gain in zip(names, original, gains, strict=True):
        rows[f"c-{name}"] = value * (1 - gain / 100)
    return rows


# 3D RMS, cm, and improvement, per cent, that Zhou 2019 prints of two other programs.
PROGRAMS = {
    "Metashape (tables 7.8 to 7.11)": {
        "d1": _program((11.5, 19.8, 2.8, 4.8), (33, 57, -157, -77)),
        "d2": _program((15.7, 16.9, 5.4, 8.1), (64, 17, -42, -87)),
        "d3": _program((15.2, 13.9, 9.8, 8.4), (82, 73, 74, 59)),
        "d4": _program((7.4, 7.8, 6.3, 7.1), (-139, -487, -841, -1261)),
    },
    "Pix4D (tables 7.12 to 7.15)": {
        "d1": _program((11.2, 15.8), (57, 62), ("8p",)),
        "d2": _program((17.4, 17.9), (83, 89), ("8p",)),
        "d3": _program((14.8, 13.8), (87, 83), ("8p",)),
        "d4": _program((22.9, 6.5), (-220, -444), ("8p",)),
    },
}


@brief
@dataclass
class TwoStep:
    """What the correction did.

    before, after: adjustments of the measured and of the corrected block. velocities: the ones
    that were used. block: corrected measurements with the poses of `before`.
    """

    before: Adjustment
    after: Adjustment
    velocities: Velocities
    block: Block

    @property
    def gain(self) -> float:
        """By how much the 3D RMS of the check points became smaller, as a share of it before."""
        return 1.0 - self.after.check_rms.d3 / self.before.check_rms.d3


def two_step(
    block: Block,
    values: Mapping[str, Mapping | None],
    velocity: str = "auto",
    before: Adjustment | None = None,
    **options,
) -> TwoStep:
    """Correct the measurements of a block for effects of motion, and adjust before and after.

    values: `{slug: {parameter: number}}`, None for what the block states. velocity: see
    `velocities`. before: a blind adjustment that is there already. options: of `adjust`, the same
    for both.

    With pi(O, P) the point P in the picture at the pose O of the middle row, and O_c the pose of
    the row that shows it, an observation p becomes p - [pi(O_c, P) - pi(O, P)]: where the
    picture would show it had all rows been exposed at once. (Zhou 2019, section 7.5; read
    literally, its eq. 7.16 with 7.11 adds the difference and doubles the error when row l is
    exposed at tau (l - L/2) / L.)
    Raises what `adjust`, `velocities` and `correct` raise.
    """
    before = least_squares.adjust(block, **options) if before is None else before
    found = velocities(before.block, velocity)
    corrected = correct(found.on(before.block), values, str(found).splitlines(), velocity=None)
    return TwoStep(before, least_squares.adjust(corrected, **options), found, corrected)


@dataclass
class Configurations:
    """Adjustments of one survey.

    table: one row each: observations (`o` original, `m` motion of each image estimated, others
    corrected), camera (`8p`, `10p`), control (1, 2), RMS, mean and STD of the check points, cm:
    rms_xy, mean_xy, std_xy, rms_z ... std_3d; gain: improvement of the 3D RMS on `o`, per cent.
    adjustments: by name such as `c-8p-GCP1`.
    """

    table: pd.DataFrame
    adjustments: dict[str, Adjustment]

    def row(self, name: str) -> pd.Series:
        """The row of `c-8p-GCP1`."""
        return self.table.loc[name]


def in_pairs(points: Sequence[str]) -> tuple[list[str], list[str]]:
    """Two sets of control points, each the other's check points.

    Points that alternate from bank to bank are split two by two: odd and even would be two lines,
    and a line does not hold the tilt across it.
    """
    first = [name for n, name in enumerate(points) if n % 4 < 2]
    return first, [name for name in points if name not in first]


def configurations(
    block: Block,
    values: Mapping[str, Mapping | None],
    sets: Iterable[Sequence[str]] | None = None,
    cameras: Mapping[str, str] = CAMERAS,
    corrected: Mapping[str, str] = CORRECTED,
    per_image: str | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Configurations:
    """Original and corrected observations, with each camera model and set of control points.

    values: see `two_step`. corrected: letter and velocities (see `velocities`) of each way of
    correcting; default: the thesis's, from neighbouring images. sets: of control points, the other
    ground points check; default: `in_pairs`. per_image: slug of an effect that estimates a motion
    of each image, with priors, beside the original observations.
    """
    say = progress or (lambda what: None)
    names = block.ground["point"].tolist()
    rows, found = {}, {}
    for number, control in enumerate(in_pairs(names) if sets is None else sets, start=1):
        check = [name for name in names if name not in control]
        for short, camera in cameras.items():
            options = {"camera": camera, "control": control, "check": check}
            say(f"{short}-GCP{number}")
            kinds = {"o": least_squares.adjust(block, **options)}
            for letter, velocity in corrected.items():
                done = two_step(block, values, velocity, kinds["o"], **options)
                kinds[letter] = done.after
            if per_image is not None:
                start = kinds["o"].block
                kinds["m"] = least_squares.adjust(
                    start, effects=[per_image], priors=priors, **options
                )
            for kind, adjustment in kinds.items():
                name = f"{kind}-{short}-GCP{number}"
                found[name] = adjustment
                rows[name] = {"observations": kind, "camera": short, "control": number}
                rows[name] |= check_row(adjustment)
                rows[name]["gain"] = 100 * (1 - adjustment.check_rms.d3 / kinds["o"].check_rms.d3)
    return Configurations(pd.DataFrame.from_dict(rows, orient="index"), found)


def check_row(adjustment: Adjustment) -> dict[str, float]:
    """RMS, mean and STD of the check points: horizontal, height and 3D, cm, as tables have them."""
    return {
        f"{what}_{part}": 100 * float(value)
        for what in ("rms", "mean", "std")
        for part, value in zip(
            ("xy", "z", "3d"), np.asarray(getattr(adjustment, f"check_{what}")), strict=True
        )
    }
