"""Which ways of estimating a rolling shutter a block's geometry and clocks support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from corridor.core import adjustment as least_squares
from corridor.core.adjustment import Adjustment
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.preparation import Velocities, velocities

# A readout known worse than this corrects little; ground that gets this much worse is a loss.
POOR_READOUT, WORSE_GROUND = 0.2, 1.5
# Less than this share of a velocity's information from the flight, and nothing can be mended.
LEAST_SHARE = 0.5


@brief
@dataclass
class ReadoutFromVelocities:
    """A readout estimated in the adjustment from velocities that are themselves in error.

    adjustment: the plain one. plain, plain_sigma: its readout, s. share: of the information on
    the readout that the flight gives and not the errors of the velocities (1: exact ones): the
    plain readout is that share of the true one. readout, sigma: freed of the attenuation, NaN
    where the share is below LEAST_SHARE.
    """

    adjustment: Adjustment
    velocities: Velocities
    plain: float
    plain_sigma: float
    share: float
    readout: float
    sigma: float

    def __str__(self) -> str:
        head = (
            f"readout {1000 * self.plain:.1f} +- {1000 * self.plain_sigma:.1f} ms as estimated, "
            f"velocities by {self.velocities.method}; {100 * max(self.share, 0):.0f} % of what "
            "tells of it is the flight's, the rest errors of the velocities"
        )
        if np.isfinite(self.readout):
            return f"{head}\nfreed of them: {1000 * self.readout:.1f} +- {1000 * self.sigma:.1f} ms"
        return (
            f"{head}\nThe velocities differ between images by little more than their errors: this "
            "is no measurement of the readout. Take velocities from GNSS or a smooth flight "
            "(strip), or measure the readout from photographs."
        )


def readout_with_errors(
    block: Block,
    effect: str,
    velocity: str = "neighbours",
    camera: str = "fraser8",
    draws: int = 6,
    seed: int = 0,
    **options,
) -> ReadoutFromVelocities:
    """The readout of a block, with errors of its time stamps treated as errors of a regressor.

    block: adjusted, with times. effect: slug of an effect with one shared parameter, linear in
    the velocity. options: of `adjust`.

    Velocities in error add information that is not there: the estimate is attenuated by
    share = (N - E) / N, with N the reduced normal equation of the readout and E what it would be
    from the errors alone, which are drawn anew from the rounding of the stamps (moment estimator
    of errors in variables, W. Fuller 1987, section 1.2). A smooth flight through all stamps of a
    strip has errors that do not depend on what it states (Berkson's kind) and no attenuation.
    """
    found = velocities(block, velocity)
    plain = least_squares.adjust(found.on(block), camera=camera, effects=[effect], **options)
    value, sigma, information = _shared(plain)
    noise = []
    rng = np.random.default_rng(seed)
    half = found.stamp_s / 2
    for _ in range(draws if half and velocity == "neighbours" else 0):
        late = plain.block.copy()
        time = late.column("images", "time_s")
        late.images = late.images.assign(time_s=time + rng.uniform(-half, half, len(time)))
        shaken = velocities(late, velocity)
        wrong = Velocities(shaken.velocity - found.velocity, found.sigma, velocity)
        errors = least_squares.adjust(
            wrong.on(plain.block), camera=camera, effects=[effect], **options
        )
        noise.append(_shared(errors))
    share, scatter = 1.0, 0.0
    if noise:
        answer, _, false = np.transpose(noise)
        share = 1.0 - float(np.mean(false)) / information
        # What the errors alone would say of the readout, by chance.
        scatter = float(np.sqrt(np.mean((answer * false) ** 2))) / information
    mended = share >= LEAST_SHARE
    return ReadoutFromVelocities(
        plain, found, value, sigma, share,
        value / share if mended else float("nan"),
        float(np.hypot(sigma, scatter)) / share if mended else float("nan"),
    )  # fmt: skip


def _shared(adjustment: Adjustment) -> tuple[float, float, float]:
    """Value, sigma and information (1 / s^2 at sigma naught 1) of the one shared parameter."""
    table = adjustment.effects
    if len(table) != 1:
        raise InputError(
            f"effect {table['slug'].iloc[0]} has {len(table)} values: a readout from velocities is "
            "one that the block shares"
        )
    value, sigma = float(table["value"].iloc[0]), float(table["sigma"].iloc[0])
    return value, sigma, (adjustment.sigma0 / sigma) ** 2


@brief
@dataclass
class Support:
    """Whether a block supports a way of estimating a shutter, and the sentence that says why."""

    effect: str
    supported: bool
    sentence: str


def supported(
    block: Block,
    readout: str,
    per_image: Sequence[str] = (),
    camera: str = "fraser8",
    velocity: str = "auto",
    **options,
) -> list[Support]:
    """What the geometry of an adjusted block can carry.

    readout: slug of the effect with one shared readout and known velocities; per_image: slugs of
    effects with a motion of their own for each image. options: of `adjust`.

    One readout is supported where it is positive and its standard deviation, freed of errors of
    the velocities, is below a fifth of it; motions of the images where the standard deviations of
    the measured ground points (else of the tie points) grow by less than half.
    """
    told = []
    found = readout_with_errors(block, readout, _method(block, velocity), camera, **options)
    # Rows are read forward in time: what is negative is no readout, however small its sigma.
    good = bool(
        np.isfinite(found.readout) and found.sigma < POOR_READOUT * max(found.readout, 1e-12)
    )
    word = "supports" if good else "does not support"
    told.append(Support(readout, good, f"The block {word} one shared readout ({readout}): {found}"))
    reference = least_squares.adjust(block, camera=camera, **options)
    before = _ground_sigma(reference)
    for slug in per_image:
        try:
            after = _ground_sigma(
                least_squares.adjust(reference.block, camera=camera, effects=[slug], **options)
            )
        except (AdjustmentFailed, InputError) as failed:
            told.append(Support(slug, False, f"The block does not support {slug}: {failed}"))
            continue
        growth = after / before
        good = bool(growth < WORSE_GROUND)
        told.append(
            Support(
                slug, good,
                f"The block {'supports' if good else 'does not support'} {slug}: ground points "
                f"have a sigma of {100 * after:.1f} cm with it and {100 * before:.1f} cm without "
                f"(times {growth:.1f}).",
            )
        )  # fmt: skip
    return told


def _method(block: Block, velocity: str) -> str:
    return velocities(block, velocity).method if velocity == "auto" else velocity


def _ground_sigma(adjustment: Adjustment) -> float:
    """Median 3D standard deviation of check points, or of points of three rays and more, m."""
    points = adjustment.points
    chosen = points["point"].isin(adjustment.check_points["point"])
    if not chosen.any():
        chosen = points["rays"] >= 3
    sigma = adjustment.point_sigma[chosen.to_numpy()]
    # Sigma naught takes in what a model explains; here the geometry alone counts.
    return float(np.nanmedian(np.linalg.norm(sigma, axis=1))) / adjustment.sigma0
