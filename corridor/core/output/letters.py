"""Letters for which pictures and print have no form, written by their numbers.

The font is the one that comes with matplotlib, on every machine: the same names give the same
bytes. What it lacks (Chinese, Japanese, Korean, say) would show as boxes; of what is written from
the right, or joins its letters (Arabic, Hebrew, Devanagari, Thai ...), it would show the letters
one by one in the wrong order.
"""

from __future__ import annotations

import re
from functools import lru_cache

# Blocks of Unicode 15.1: Hebrew to Arabic Extended-A, Devanagari to Myanmar, Khmer, Mongolian, and
# the presentation forms of Hebrew and Arabic.
_JOINED = re.compile(r"[\u0590-\u08ff\u0900-\u109f\u1780-\u18af\ufb1d-\ufdff\ufe70-\ufeff]")
# Such a run, also where a long name was cut.
CODED = re.compile(r"\[[0-9A-F]{3,6}[] \u2026]")
NOTE = "letters that this print has no form for stand as their Unicode numbers, as [6A4B 53F0]"


@lru_cache(maxsize=1)
def _known() -> frozenset[int]:
    from matplotlib.font_manager import FontProperties, findfont, get_font

    return frozenset(get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap())


def printable(text: str) -> str:
    """The text, runs of letters without a form by their Unicode numbers: `[6A4B 53F0] 3`."""
    if text.isascii():
        return text
    out: list[str] = []
    run: list[str] = []
    for letter in f"{text}\0":
        lacks = letter > "\x7f" and (ord(letter) not in _known() or _JOINED.match(letter))
        if lacks:
            run.append(f"{ord(letter):X}")
            continue
        if run:
            out.append(f"[{' '.join(run)}]")
            run = []
        out.append(letter)
    return "".join(out)[:-1]
