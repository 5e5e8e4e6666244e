"""The result as a folder, with every picture the package has for it."""

import json
import re

import pytest
from made_up import adjustment, corridor

from corridor.interface.figures import of_adjustment
from corridor.interface.report import CAPTIONS, save_adjustment


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """An adjustment, the folder of its result, and what was written."""
    made, folder = adjustment(corridor(images=8)), tmp_path_factory.mktemp("result") / "out"
    return made, folder, save_adjustment(made, folder, of_adjustment(made))


def test_every_picture_has_a_caption_and_every_caption_a_picture():
    assert set(of_adjustment(adjustment(corridor(images=8)))) == set(CAPTIONS)


def test_the_folder_holds_every_picture_alone_and_in_the_page(saved):
    _, folder, written = saved
    names = {path.name for path in written}
    assert {f"{name}.png" for name in CAPTIONS} <= names
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert len(re.findall(r'src="data:image/png;base64,', page)) == len(CAPTIONS)
    content = json.loads((folder / "adjustment.json").read_text())
    assert content["pictures"] == [f"{name}.png" for name in CAPTIONS]


def test_the_same_adjustment_gives_the_same_page(saved, tmp_path):
    made, folder, _ = saved
    save_adjustment(made, tmp_path / "again", of_adjustment(made))
    one, two = ((where / "report.html").read_bytes() for where in (folder, tmp_path / "again"))
    assert one == two
    assert str(folder.parent).encode() not in one and str(tmp_path).encode() not in two
