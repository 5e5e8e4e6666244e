"""Names in letters that pictures and print have no form for: written by their numbers, and told."""

import re
import warnings
import zlib

import numpy as np
import pytest
from matplotlib.figure import Figure

from corridor.core.output import CODED, NOTE, Report, Table, png, printable
from corridor.tools.certificate.paper import pdf


@pytest.mark.parametrize("text", ["GCP 1", "Süd σ ≤ 3 µm", "Дамба", "Πέτρα", "Žlutý kůň"])
def test_what_the_font_has_is_left(text):
    assert printable(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [("橋台3", "[6A4B 53F0]3"), ("ダム A", "[30C0 30E0] A"), ("댐", "[B310]"),
     ("سد 7", "[633 62F] 7"), ("סכר", "[5E1 5DB 5E8]"), ("बाँध", "[92C 93E 901 927]")],
)  # fmt: skip
def test_what_it_lacks_or_would_turn_round_stands_as_numbers(text, shown):
    """U+6A4B is 橋 in the Unicode standard, U+0633 the Arabic letter seen."""
    assert printable(text) == shown and CODED.search(shown)
    assert printable(shown) == shown


def figure(label):
    made = Figure(figsize=(3, 2))
    axes = made.add_subplot()
    axes.set_title(label, parse_math=False)
    axes.set_xticks([0, 1], [label, "A"])
    return made


def test_a_picture_draws_no_boxes_and_says_so():
    made = figure("橋")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of every letter without a form
        content = png(made)
    told = [text.get_text() for text in made.texts]
    assert told == [NOTE] and made.axes[0].get_title() == "[6A4B]"
    assert content == png(figure("橋"))


def test_a_picture_of_names_that_the_font_has_says_nothing():
    made = figure("Süd")
    png(made)
    assert not made.texts


def texts_of(sheets: bytes) -> str:
    """What stands on the sheets of a PDF: glyphs are numbered as the letters are, below 256."""
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", sheets, re.DOTALL)
    out = []
    for stream in streams:
        try:
            out.append(zlib.decompress(stream).decode("latin-1"))
        except zlib.error:
            continue
    shown = "".join("".join(re.findall(r"\(((?:[^()\\]|\\.)*)\)", text)) for text in out)
    return shown.replace("\0", "")


def report(name):
    return Report(
        f"Certificate of {name}", "It is.", (), [Table("Control", ("point",), ((name,),), "l")]
    )


def test_a_certificate_on_paper_has_every_name_and_says_how():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sheets = pdf(report("橋台3"))
    plain = texts_of(sheets)
    assert plain.count("[6A4B 53F0]3") == 2
    assert "stand as their Unicode numbers" in plain
    assert "Unicode" not in texts_of(pdf(report("Süd")))
    assert sheets == pdf(report("橋台3")) and np.char.startswith(sheets, b"%PDF")
