"""What a block can know by itself, filled in where nobody has given it."""

from __future__ import annotations

import copy
import os
from typing import NamedTuple

import numpy as np
import pandas as pd

from corridor.core.block import RATES, SIGMAS, VELOCITY, Block, read
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.core.gnss import Antenna, of_block
from corridor.core.preparation.plausibility import position_difference
from corridor.core.preparation.plausibility_of_motion import paired_speeds, velocity_warnings
from corridor.core.preparation.record import (
    AGREES,
    ARBITRARY,
    CONTRADICTS,
    FRAME,
    UNCHECKED,
    Derived,
    Witness,
    derived,
    record,
)
from corridor.core.preparation.smoothing import FASTEST_M_S, of_gnss, of_poses, of_track, rounding
from corridor.core.preparation.tracks import interleaved

_VELOCITY_SIGMA, _COMMON_ERROR = ("svx", "svy", "svz"), ("dvx", "dvy", "dvz")
_LEAST_PAIRS = 5


class Prepared(NamedTuple):
    """block: with what it can know by itself. derived: what of it was derived, now or before.

    notes: sentences on what could not be.
    """

    block: Block
    derived: list[Derived]
    notes: list[str]


def prepare(block: Block | str | os.PathLike, velocities: bool = True) -> Prepared:
    """The block with antenna positions, velocities, flights and angular rates it can tell itself.

    block: as read, or its folder. velocities: and angular rates too, which only effects look at; of
    100,000 images they take seconds.
    Antenna positions: from track.csv where there is no gnss.csv. Velocities vx, vy, vz with their
    sigmas svx, svy, svz (m/s, world): by the smoother of `corridor.gnss`, from track.csv, else
    gnss.csv, else the poses of images.csv; a drone that brakes or turns between two positions has
    a large sigma there. Filled in for all images or none: an effect needs them all. Flights: by
    the track that covers an image's time. Angular rates wx, wy, wz (rad/s, camera frame): from
    rates.csv, at the image's time.

    What is given is never replaced, and the block handed in is not changed. What was derived is
    recorded in the table `derived` of block.toml, so that a written block tells it apart from what
    was measured; preparing twice changes nothing. Missing columns never stop it.
    Raises InputError where track.csv contradicts the images: other clock, single positions alone.
    """
    block = read(block)
    made = copy.copy(block)
    notes: list[str] = []
    made.extra = copy.deepcopy(block.extra)
    known = np.isfinite(made.column("images", "time_s"))
    if len(made.track) and known.any():
        _flights_of_track(made)
    flown = _antenna(made, notes, velocities) if len(made.track) and known.any() else None
    if velocities and known.all():
        if _each_flight_one_track(made, notes):
            _velocities(made, flown)
        _rates(made)
    # Whatever is derived is recorded.
    made = block if made.extra == block.extra else made
    return Prepared(made, derived(made), notes)


def _flights_of_track(block: Block) -> None:
    """Flights of images.csv, where only track.csv names them and each image is in one of them."""
    track = block.track
    if "flight" not in track or track["flight"].isna().any() or block.has("images.flight"):
        return
    time = block.column("images", "time_s")
    spans = track.groupby("flight", sort=False)["time_s"].agg(["min", "max"])
    inside = (time[:, None] >= spans["min"].to_numpy()) & (time[:, None] <= spans["max"].to_numpy())
    if len(spans) < 2 or not (inside.sum(axis=1) == 1).all():
        return
    names = spans.index.astype(str).to_numpy(object)[inside.argmax(axis=1)]
    block.images = block.images.assign(flight=pd.Series(names, block.images.index, dtype="str"))
    record(
        block, "images.flight", "track.csv", None,
        f"Flights are those of the track: {len(spans)} of them.",
    )  # fmt: skip


def _each_flight_one_track(block: Block, notes: list[str]) -> bool:
    """Whether each flight is of one drone, after those that names tell apart were separated."""
    found = interleaved(block)
    if found is None:
        return True
    told = found.sentence(block)
    if not found.named or block.has("images.flight"):
        notes.append(told)
        return False
    names = pd.Series([f"track {k + 1}" for k in found.track], block.images.index, dtype="str")
    block.images = block.images.assign(flight=names)
    jumps = Witness("positions", AGREES, f"they jump to and fro, {found.apart_m:.0f} m apart")
    record(block, "images.flight", found.named, None, told, witnesses=[jumps])
    return True


def _antenna(block: Block, notes: list[str], velocities: bool) -> Antenna | None:
    """The track at the exposures; its positions go into gnss.csv where that is missing."""
    needed = not len(block.gnss)
    lacking = velocities and not np.isfinite(block.numbers("images", *VELOCITY)).all()
    if not needed and not lacking:
        return None
    try:
        flown = of_block(block)
    except AdjustmentFailed as failed:
        notes.append(f"No antenna position comes from track.csv: {failed}.")
        return None
    except InputError:
        if needed:
            raise
        return None  # Positions are given: the track was to tell velocities only.
    if needed:
        block.gnss = flown.gnss
        found = flown.gnss
        record(
            block, "gnss", "track.csv",
            found[list(SIGMAS)].to_numpy() if "sx" in found else None,
            f"Antenna positions of {len(found)} of {len(block.images)} images are interpolated "
            "from the track.", witnesses=[_as_posed(block)],
        )  # fmt: skip
        notes += flown.notes
    return flown


def _velocities(block: Block, flown: Antenna | None) -> None:
    given = block.numbers("images", *VELOCITY)
    stated = block.numbers("images", *_VELOCITY_SIGMA)
    lacking = ~np.isfinite(given).all(axis=1)
    if not lacking.any():
        return
    velocity, sigma, common = given.copy(), stated, np.zeros_like(given)
    sources = []
    for source, found in _sources(block, flown):
        lost = ~np.isfinite(velocity).all(axis=1)
        if not lost.any():
            break
        table = found()
        take = lost & np.isfinite(table).all(axis=1)
        take &= np.linalg.norm(table[:, :3], axis=1) < FASTEST_M_S
        if take.any():
            velocity[take], sigma[take] = table[take, :3], table[take, 3:6]
            common[take] = table[take, 6:]
            sources.append(source)
    if not np.isfinite(velocity).all():
        return
    block.put("images", VELOCITY, velocity)
    block.put("images", _VELOCITY_SIGMA, sigma)
    if common.any():
        block.put("images", _COMMON_ERROR, common)
    several, witness = sigma[lacking], _as_flown(block, sources)
    regular = ""
    if rounding(block.column("images", "time_s")) and sources != ["track.csv"]:
        regular = ", at rounded time stamps"
    text = (
        f"Velocities of {int(lacking.sum())} of {len(given)} images are derived from "
        f"{' and '.join(sources)}{regular}: sigma {np.median(several):.2g} m/s (median), "
        f"{several.max():.2g} m/s (largest)."
    )
    columns = [f"images.{axis}" for axis in VELOCITY]
    record(block, columns, " and ".join(sources), several, text, witnesses=[witness])


def _as_flown(block: Block, sources: list[str]) -> Witness:
    """What the poses of neighbouring images say of velocities that come from elsewhere."""
    poses = "the poses of images.csv"
    if poses in sources:
        return Witness("another source", UNCHECKED, "poses are the only one")
    pairs, doubts = paired_speeds(block), velocity_warnings(block)
    if doubts:
        return Witness(poses, CONTRADICTS, doubts[0])
    if len(pairs.told) < _LEAST_PAIRS or block.extra.get(FRAME) == ARBITRARY:
        return Witness(poses, UNCHECKED, "too slow, or too few neighbours")
    return Witness(poses, AGREES, f"{np.median(pairs.along):.2f} of the way from image to image")


def _as_posed(block: Block) -> Witness:
    """What the poses say of antenna positions that come from a track."""
    poses, centres = "the poses of images.csv", block.numbers("images", *"xyz")
    given = np.full(centres.shape, np.nan)
    given[block.image_rows("gnss")] = block.numbers("gnss", *"xyz")
    away = np.linalg.norm(given - centres, axis=1)
    if not np.isfinite(away).any():
        return Witness(poses, UNCHECKED, "there are none")
    doubt = position_difference("track.csv", given, "images.csv", centres)
    if doubt or block.extra.get(FRAME) == ARBITRARY:
        return Witness(
            poses, CONTRADICTS if doubt else UNCHECKED, doubt or "in a frame of their own"
        )
    return Witness(poses, AGREES, f"{np.nanmedian(away):.2g} m apart (median)")


def _sources(block: Block, flown: Antenna | None):
    """(name, callable that gives velocities, sigmas, common errors (images, 9)), the best first."""
    if flown is not None:
        yield "track.csv", lambda: of_track(block, flown)
    elif len(block.gnss):
        yield "gnss.csv", lambda: of_gnss(block)
    # Without a scale, what poses fly in a second is no speed.
    if block.extra.get(FRAME) != ARBITRARY:
        yield "the poses of images.csv", lambda: of_poses(block)


def _rates(block: Block) -> None:
    """Angular rates of images.csv from the records of rates.csv, at the images' times."""
    if not len(block.rates) or any(block.has(f"images.{axis}") for axis in RATES):
        return
    rate = block.numbers("rates", *RATES)
    at = block.column("rates", "time_s")
    time = block.column("images", "time_s")
    by = next((c for c in ("image", "flight") if block.has(f"rates.{c}")), None)
    if by is None:
        mine = [np.arange(len(at))] * len(time)
    else:
        owner = {
            "image": block.images["image"].astype(str).to_numpy(),
            "flight": np.array(block.flight_names, dtype=object)[block.image_flight],
        }[by]
        records = block.rates.groupby(block.rates[by].astype(str), sort=False).indices
        mine = [records.get(str(name), np.zeros(0, int)) for name in owner]
    out = np.full((len(time), 3), np.nan)
    for n, rows in enumerate(mine):
        rows = rows[np.argsort(at[rows], kind="stable")]
        if len(rows) and at[rows[0]] <= time[n] <= at[rows[-1]]:
            out[n] = [np.interp(time[n], at[rows], rate[rows, axis]) for axis in range(3)]
    known = np.isfinite(out).all(axis=1)
    if not known.any():
        return
    block.put("images", RATES, out)
    record(
        block, [f"images.{axis}" for axis in RATES], "rates.csv", None,
        f"Angular rates of {int(known.sum())} of {len(out)} images are those of rates.csv at "
        "their times.",
    )  # fmt: skip
