"""Days, weeks and time systems.

A moment is a day ("2022-11-06"), the seconds since its 00:00, and the time system both are
counted in: GPST, UTC, JST, ... The system is what a file names; it is never guessed.
"""

import re
from collections.abc import Sequence
from datetime import date, timedelta

from corridor.core.errors import InputError

DAY_S = 86400.0
WEEK_S = 604800.0
_GPS_START = date(1980, 1, 6)
_MJD_START = date(1858, 11, 17)

# GPS time minus UTC from the given day on. Source: IERS Bulletin C.
_LEAPS = (
    ("1981-07-01", 1), ("1982-07-01", 2), ("1983-07-01", 3), ("1985-07-01", 4), ("1988-01-01", 5),
    ("1990-01-01", 6), ("1991-01-01", 7), ("1992-07-01", 8), ("1993-07-01", 9), ("1994-07-01", 10),
    ("1996-01-01", 11), ("1997-07-01", 12), ("1999-01-01", 13), ("2006-01-01", 14),
    ("2009-01-01", 15), ("2012-07-01", 16), ("2015-07-01", 17), ("2017-01-01", 18),
)  # fmt: skip
# Constant difference to GPS time, seconds.
_LIKE_GPS = {"GPST": 0.0, "GST": 0.0, "QZSST": 0.0, "BDT": -14.0, "TAI": 19.0}
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)")
_ZONE = re.compile(r"UTC([+-])(\d{1,2})(?::?([0-5]\d))?")


def leap_seconds(day: str) -> int:
    """GPS time minus UTC on a day, seconds: 18 since 2017. Source: IERS Bulletin C."""
    return max((seconds for since, seconds in _LEAPS if since <= day), default=0)


def time_system(name: str) -> str:
    """The usual short name: GPST, UTC, JST, GST, BDT, QZSST, TAI, or UTC+hh:mm.

    Raises InputError for a system that is not known.
    """
    text = re.sub(r"\s+", "", name).upper()
    text = {"GPS": "GPST", "GPSTIME": "GPST", "GMT": "UTC", "Z": "UTC"}.get(text, text)
    if text in _LIKE_GPS or text in ("UTC", "JST"):
        return text
    zone = _ZONE.fullmatch(text)
    if zone and int(zone[2]) <= 14:
        return f"UTC{zone[1]}{int(zone[2]):02d}:{zone[3] or '00'}"
    raise InputError(
        f"time system {name!r} is not known; give GPST, UTC, JST, BDT, GST, TAI, or UTC+hh:mm for "
        "a clock that shows a zone's time"
    )


def ahead_of_utc(system: str, day: str) -> float:
    """Seconds by which clocks of a time system are ahead of UTC on a day."""
    system = time_system(system)
    if system in _LIKE_GPS:
        return leap_seconds(day) + _LIKE_GPS[system]
    zone = _ZONE.fullmatch("UTC+09:00" if system == "JST" else system)
    if zone is None:
        return 0.0
    return (3600.0 * int(zone[2]) + 60.0 * int(zone[3])) * (-1 if zone[1] == "-" else 1)


def gps_day(week: int, seconds: float) -> tuple[str, float]:
    """Day and seconds of the day, of a GPS week counted from 1980 and seconds of that week."""
    days, rest = divmod(seconds, DAY_S)
    return (_GPS_START + timedelta(days=7 * week + int(days))).isoformat(), rest


def mjd_day(text: str) -> tuple[str, float]:
    """Day and seconds of the day of a Modified Julian Day as it is written.

    The decimals are taken for themselves, so that no digit is lost beside the five of the day.
    """
    whole, _, decimals = text.strip().partition(".")
    day = (_MJD_START + timedelta(days=int(whole))).isoformat()
    return day, float(f"0.{decimals or '0'}") * DAY_S


def seconds_of_clock(text: str) -> float | None:
    """Seconds of `h:mm:ss.s`; None where a text is not a time of a day."""
    match = _CLOCK.fullmatch(text)
    if not match or int(match[1]) > 24 or int(match[2]) > 59 or float(match[3]) >= 61:
        return None
    return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3])


def day_of(year: int, month: int, day: int) -> str:
    """The day as text. Raises ValueError where the calendar has no such day."""
    if year < 100:
        year += 2000 if year < 80 else 1900
    return date(year, month, day).isoformat()


def days_between(first: str, second: str) -> int:
    """Days from the first to the second."""
    return (date.fromisoformat(second) - date.fromisoformat(first)).days


def day_after(day: str) -> str:
    """The next day."""
    return (date.fromisoformat(day) + timedelta(days=1)).isoformat()


def on_one_day(stamps: Sequence[tuple[str, float]]) -> tuple[str, list[float]]:
    """The first stamp's day, and all stamps as seconds since its 00:00.

    To the nanosecond: the same moment is the same number, whatever it was counted from.
    """
    first = stamps[0][0]
    days: dict[str, float] = {}
    for day, _ in stamps:
        if day not in days:
            days[day] = DAY_S * days_between(first, day)
    return first, [round(days[day] + seconds, 9) for day, seconds in stamps]


def clock(seconds: float) -> str:
    """`hh:mm:ss` for messages, with milliseconds where there are any."""
    days, rest = divmod(round(seconds, 3), DAY_S)
    minutes, second = divmod(rest, 60.0)
    hour, minute = divmod(int(minutes), 60)
    shown = f"{second:06.3f}".removesuffix(".000")
    return f"{hour:02d}:{minute:02d}:{shown}" + (f" ({days:+.0f} d)" if days else "")


def in_words(seconds: float) -> str:
    """A time span for messages: `18 s`, `7 h`, `2 days`."""
    size = abs(seconds)
    for unit, length in (("days", DAY_S), ("h", 3600.0), ("min", 60.0)):
        if size >= length and (size / length).is_integer():
            count = size / length
            return f"{count:g} {'day' if unit == 'days' and count == 1 else unit}"
    return f"{size:.6g} s"
