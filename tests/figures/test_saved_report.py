"""The result as a folder, with every picture the package has for it."""

import json
import re

import pytest
from made_up import adjustment, corridor

from corridor import figures
from corridor.figures import of_adjustment
from corridor.report import CAPTIONS, save_adjustment


def test_every_picture_has_a_caption_and_every_caption_a_picture():
    assert set(of_adjustment(adjustment(corridor(images=8)))) == set(CAPTIONS)


def test_the_folder_holds_every_picture_alone_and_in_the_page(tmp_path):
    made = adjustment(corridor(images=8))
    written = save_adjustment(made, tmp_path / "out", of_adjustment(made))
    names = {path.name for path in written}
    assert {f"{name}.png" for name in CAPTIONS} <= names
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert len(re.findall(r'src="data:image/png;base64,', page)) == len(CAPTIONS)
    content = json.loads((tmp_path / "out" / "adjustment.json").read_text())
    assert content["pictures"] == [f"{name}.png" for name in CAPTIONS]


def test_the_same_adjustment_gives_the_same_page(tmp_path):
    made = adjustment(corridor(images=8))
    for name in ("a", "b"):
        save_adjustment(made, tmp_path / name, of_adjustment(made))
    one, two = ((tmp_path / name / "report.html").read_bytes() for name in ("a", "b"))
    assert one == two
    assert str(tmp_path).encode() not in one


def test_the_old_name_writes_the_same_and_says_what_is_new(tmp_path):
    made = adjustment(corridor(images=8))
    with pytest.warns(DeprecationWarning, match="of_adjustment"):
        written = figures.save_adjustment(made, tmp_path / "out")
    assert {f"{name}.png" for name in CAPTIONS} <= {path.name for path in written}
