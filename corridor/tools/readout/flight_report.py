"""What a flight tells of a readout time: which to use, sentences, tables, numbers, and the folder
with page, picture and numbers."""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corridor.core import registry
from corridor.core.brief import brief
from corridor.core.output import (
    Report,
    Table,
    check_folder,
    png,
    rounded,
    short,
    whole_folder,
    write_json,
)
from corridor.core.photographs import PublishedReadout
from corridor.tools.readout.motion import Motion
from corridor.tools.readout.next_photographs import Advice

PICTURE, _PAGE = "readout.png", "report.html"
# A readout that was not told is none: whoever reads readout.json finds no number.
_RESULT = {True: "readout.json", False: "refused.json"}
_OURS = (_PAGE, PICTURE, *_RESULT.values())
_MOST_PUBLISHED = 6
# Sources of one camera differ by 5 to 10 per cent.
PUBLISHED_SHARE = 0.07
# Eight and ten camera parameters, or a sign, contradict beyond so many sigmas.
CONTRADICTS = 3.0
_GYROSCOPE_SCALE = (
    "A gyroscope that shows all turns too large by some share makes the readout time too short by "
    "as much, as far as rotations determine it: strips do not show that, and the sigma leaves it "
    "out."
)


@dataclass(frozen=True)
class Left:
    """The readout, s, and its formal sigma without one strip."""

    strip: str
    images: int
    readout: float
    sigma: float


@dataclass(frozen=True)
class Turns:
    """What rates.csv says of how the camera turned while it was read.

    rate (m, 3): rad/s about the camera's axes, mean of each readout, in the order of images.csv.
    estimated: what was estimated with the readout, (name, value, formal sigma, unit).
    """

    rate: np.ndarray
    estimated: tuple[tuple[str, float, float, str], ...]

    @property
    def median_deg_s(self) -> float:
        """Median of the angular rates, degrees a second."""
        return float(np.degrees(np.median(np.linalg.norm(self.rate, axis=1))))


@brief
@dataclass(frozen=True)
class FlightReadout:
    """What a flight tells of its camera's readout time, first to last row. Times in s.

    camera: its name. told: whether the flight tells it; reasons: sentences, why not.
    readout, sigma: by the flight, one sigma, all included: the formal one (noise, errors and delay
        of the velocities, turns that nobody wrote down), or what the strips show when each is
        left out (`geometry.cluster_robust_sigma`), where that contradicts it. formal, jackknife:
        either alone. left: without each strip. eight, eight_sigma: with b1 = b2 = 0.
    delay: by which the speeds were written late, s, with its sigma. motion: of the images, in the
        order of images.csv, with what it is off as the pictures say. turns: of a block with
        rates.csv, else None.
    published: of this camera and mode; stated: what the block states, s. at_once: who says that all
        rows are exposed at once, empty where nobody does. advice: photographs that
        would settle it.
    place (m, 3) m, names: of the images. sigma0: of the adjustment. height: above the ground, m.
        rows: of a picture. notes: sentences of the preparation.
    """

    camera: str
    readout: float
    sigma: float
    formal: float
    jackknife: float
    left: tuple[Left, ...]
    eight: float
    eight_sigma: float
    delay: tuple[float, float]
    motion: Motion
    reasons: tuple[str, ...]
    published: tuple[PublishedReadout, ...] = ()
    stated: float | None = None
    at_once: str = ""
    advice: Advice | None = None
    place: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    names: tuple[str, ...] = ()
    sigma0: float = 1.0
    height: float = 0.0
    rows: int = 0
    notes: tuple[str, ...] = ()
    turns: Turns | None = None

    @property
    def advises(self) -> bool:
        """Whether there are photographs worth taking: by which the sigma would fall by a fifth."""
        known = self.at_once or self.advice is None
        return not known and self.advice.sigma <= 0.8 * self.sigma

    @property
    def told(self) -> bool:
        """Whether the flight tells the readout."""
        return not self.reasons

    @property
    def is_short(self) -> bool:
        """Whether what the flight tells is that the shutter is global, or nearly."""
        return self.told and abs(self.readout) <= CONTRADICTS * self.sigma

    def __str__(self) -> str:
        return str(report_of(self))

    def _repr_html_(self) -> str:
        return report_of(self).html()


def use(found: FlightReadout) -> tuple[float | None, float | None, str]:
    """Which readout to use and its sigma, s, and why; None where none is known."""
    if found.at_once:
        return 0.0, 0.0, f"Use 0 ms: all rows are exposed at once ({found.at_once})."
    known = published_value(found)
    told = f"{1000 * found.readout:.1f} +- {1000 * found.sigma:.1f} ms"
    if known is None:
        if found.told:
            return found.readout, found.sigma, f"Use the flight's {told}: no other value is known."
        return None, None, (
            "No readout time is known: measure it from photographs (`corridor readout led --help`)"
            " or fly again as advised."
        )  # fmt: skip
    value, sigma, source = known
    word = f"{source} {1000 * value:.1f} ms"
    apart = abs(found.readout - value) / np.hypot(found.sigma, sigma)
    if not found.told:
        if apart > CONTRADICTS:
            return value, sigma, (
                f"Use the {word} with care: the flight's {told} is {apart:.1f} sigmas from it, and "
                "does not hold by itself."
            )  # fmt: skip
        return value, sigma, f"Use the {word}: the flight neither proves nor disproves it."
    if apart > 2:
        return found.readout, found.sigma, (
            f"The {word} contradicts the flight's {told} by {apart:.1f} sigmas: use the flight's, "
            "and look whether the pictures were taken in another mode."
        )  # fmt: skip
    if found.sigma < sigma:
        return found.readout, found.sigma, f"Use the flight's {told}: the {word} agrees with it."
    return value, sigma, f"Use the {word}: the flight's {told} agrees and is less certain."


def published_value(found: FlightReadout) -> tuple[float, float, str] | None:
    """Published readout from the first to the last row, its sigma, s, and whose it is."""
    rows = max(found.rows, 2)
    if found.published:
        # Published times count all rows.
        each = [1e-3 * one.readout_ms * (rows - 1) / rows for one in found.published]
        value, source = float(np.median(each)), "published"
        scatter = float(np.std(each, ddof=1)) if len(each) > 1 else 0.0
    elif found.stated:
        value, scatter, source = found.stated, 0.0, "block's stated"
    else:
        return None
    return value, max(PUBLISHED_SHARE * value, scatter), source


def report_of(found: FlightReadout) -> Report:
    """The result as a report: the sentence, why or why not, and what it rests on."""
    _, _, why = use(found)
    if found.told:
        value = _ms(found.readout, found.sigma)
        witness = "the flight itself" + (" and its gyroscope" if found.turns else "")
        said, warnings = f"The readout time is {value} by {witness}.", []
        if found.is_short:
            most = 1000 * (max(found.readout, 0.0) + 2 * found.sigma)
            said = f"The flight shows no rolling shutter: {value}, at most {most:.2g} (two sigma)."
        opening = f"{said} {why}"
    else:
        opening = f"This flight does not determine the readout time. {why}"
        warnings = list(found.reasons)
    return Report(
        f"Readout time of camera {found.camera} from a flight",
        f"{opening} {_advice(found)}".strip(),
        warnings,
        [_values(found), _strips(found), *_published(found), _rests_on(found)],
    )


def _ms(value: float, sigma: float) -> str:
    text, error = rounded(1000 * value, 1000 * sigma)
    return f"{text} \u00b1 {error} ms"


def _advice(found: FlightReadout) -> str:
    if not found.advises:
        return ""
    places = ", ".join(found.advice.images)
    return (
        f"Four more photographs from where {places} were taken, {found.advice.how}, would bring it "
        f"to {1000 * found.advice.sigma:.2g} ms."
    )


def _values(found: FlightReadout) -> Table:
    known = np.isfinite(found.jackknife) and found.jackknife > 0
    jackknife = rounded(0.0, 1000 * found.jackknife)[1] if known else "\u2013"
    rows = [
        ("by the flight", *_pair(found.readout, found.sigma), "all included"),
        ("", "", rounded(0.0, 1000 * found.formal)[1], "of it formal"),
        ("", "", jackknife, "by the jackknife over strips alone"),
        ("with eight camera parameters", *_pair(found.eight, found.eight_sigma), "b1 = b2 = 0"),
    ]
    known = published_value(found)
    if known is not None:
        rows.append((known[2], *_pair(known[0], known[1]), "modes and sources differ by so much"))
    return Table("Readout time, first to last row", ("", "ms", "sigma", ""), tuple(rows), "lrrl")


def _pair(value: float, sigma: float) -> tuple[str, str]:
    return rounded(1000 * value, 1000 * sigma)


def _turn_deg_s(found: FlightReadout) -> float:
    return float(np.degrees(np.median(found.motion.turning)))


def _strips(found: FlightReadout) -> Table:
    rows = tuple((one.strip, str(one.images), *_pair(one.readout, one.sigma)) for one in found.left)
    return Table("Without one strip", ("left out", "images", "ms", "formal"), rows, "lrrr")


def _published(found: FlightReadout) -> list[Table]:
    if not found.published:
        return []
    shown = found.published[:_MOST_PUBLISHED]
    rows = tuple((f"{o.readout_ms:g}", o.mode or "not stated", short(o.source, 60)) for o in shown)
    more = len(found.published) - len(shown)
    notes = (f"and {more} more",) if more else ()
    return [Table("Published, all rows", ("ms", "mode", "source"), rows, "rll", notes)]


def _rests_on(found: FlightReadout) -> Table:
    speed = np.linalg.norm(found.motion.velocity, axis=1)
    low, middle, high = np.percentile(speed, [0, 50, 100])
    delay, delay_sigma = found.delay
    rows = [
        ("velocities", found.motion.source),
        ("speeds", f"{low:.1f} to {high:.1f} m/s, median {middle:.1f} m/s"),
        ("sigma of a velocity", f"{np.median(found.motion.sigma):.2g} m/s (median)"),
        ("sigma of a turn", f"{_turn_deg_s(found):.2g}\u00b0/s (median)"),
        ("images, sigma naught", f"{len(found.names)}, {found.sigma0:.2f}"),
    ]
    notes = found.notes
    if found.motion.given:
        rows.append(("speeds written late by", f"{delay:.2f} \u00b1 {delay_sigma:.2f} s"))
    if found.turns:
        rows.append(
            ("turns of the camera", f"rates.csv, median {found.turns.median_deg_s:.2g}\u00b0/s")
        )
        for name, value, error, unit in found.turns.estimated:
            text, sigma = rounded(value, error)
            text = _ms(value, error) if unit == "s" else f"{text} \u00b1 {sigma} {unit}"
            rows.append((name, f"{text} (formal)"))
        notes = (*notes, _GYROSCOPE_SCALE)
    return Table("What it rests on", (), tuple(rows), "ll", notes)


def _in_ms(readout: float | None, sigma: float | None) -> dict[str, float | None]:
    both = {"readout_ms": readout, "sigma_ms": sigma}
    return {key: None if value is None else 1000 * value for key, value in both.items()}


def to_dict(found: FlightReadout) -> dict:
    """The content of readout.json; times in milliseconds where the key says so."""
    value, sigma, why = use(found)
    known = published_value(found)
    witness = "velocities" + (" and recorded turns" if found.turns else "")
    return {
        "target": "flight",
        "method": f"least-squares adjustment of a survey with the {witness} of its images",
        "told": found.told,
        "reasons": list(found.reasons),
        "camera": found.camera,
        **_in_ms(found.readout, found.sigma),
        "formal_sigma_ms": 1000 * found.formal,
        "jackknife_sigma_ms": 1000 * found.jackknife,
        "rows": found.rows,
        "eight_parameters": _in_ms(found.eight, found.eight_sigma),
        "without_strip": [
            {"strip": one.strip, "images": one.images} | _in_ms(one.readout, one.sigma)
            for one in found.left
        ],
        "published": None if known is None else {
            **_in_ms(*known[:2]), "whose": known[2],
            "values": [
                {"readout_ms": one.readout_ms, "mode": one.mode, "source": one.source}
                for one in found.published
            ],
        },
        "use": _in_ms(value, sigma) | {"why": why},
        "next_photographs": None if found.advice is None else {
            "images": list(found.advice.images), "how": found.advice.how,
            "sigma_ms": 1000 * found.advice.sigma,
        },
        "velocities": {
            "source": found.motion.source, "measured": found.motion.measured,
            "sigma_m_s": float(np.median(found.motion.sigma)),
            "turn_sigma_deg_s": _turn_deg_s(found),
            "delay_s": found.delay[0], "delay_sigma_s": found.delay[1],
        },
        "gyroscope": None if found.turns is None else {
            "median_deg_s": found.turns.median_deg_s,
            "estimated": [
                {"name": name, "value": value, "formal_sigma": error, "unit": unit}
                for name, value, error, unit in found.turns.estimated
            ],
        },
        "warnings": list(found.notes),
        "pictures": [PICTURE],
    }  # fmt: skip


def can_save_flight(folder: str | os.PathLike) -> None:
    """Raises InputError, before any work is done, where `save_flight` would refuse `folder`."""
    check_folder(folder, _PAGE)


def save_flight(found: FlightReadout, folder: str | os.PathLike) -> list[Path]:
    """Writes report.html, readout.png and readout.json, whole or not at all; returns the paths.

    Where the flight does not tell, refused.json stands in place of readout.json.
    Raises InputError where `folder` is a file or a folder of something else.
    """
    picture = png(registry.room("figures").flight_readout(found, published_value(found)))
    caption = (
        "Left: the readout time by the whole flight (thick bar: the honest sigma), without each "
        "strip, with eight camera parameters, and as published. Right: where the images were taken "
        "and how fast the drone flew; circles: where four more photographs would help most."
    )
    page = report_of(found).page([("Readout time from the flight", caption, picture)])
    files = (_RESULT[found.told], _PAGE, PICTURE)
    with whole_folder(folder, _PAGE, lambda name: name in _OURS) as part:
        (part / PICTURE).write_bytes(picture)
        (part / _PAGE).write_text(page, encoding="utf-8", newline="\n")
        write_json(to_dict(found), part / files[0])
    return [Path(folder) / name for name in files]
