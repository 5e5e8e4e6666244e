"""What is refused when a block is read: each with file and row.

More of single cells and files stand in test_block_bad_input.py, of plans in simulation/, of tracks
in gnss/, of photographs in readout/.
"""

import pandas as pd
import pytest
from slips import changed, more, table, times, toml

import corridor
from corridor.interface.cli import main

# Refused when the block is read: slip -> words of the sentence.
REFUSED = {
    "control of a negative standard deviation": (
        changed("ground", sx=-0.01), "row 2: sx = -0.01 is not a"
    ),
    "a role of another program": (changed("ground", role="gcp"), "write one of control, check"),
    "names with blanks": (changed("ground", point=lambda c: c + " "), "has blanks around it"),
    "image names without suffix": (
        changed("gnss", image=lambda c: c.str.replace(".tif", "")), "image 'F1_0001' is not in"
    ),
    "image names in capitals": (
        changed("tie_points", image=lambda c: c.str.upper()), "'F1_0001.TIF' is not in images.csv"
    ),
    "image names with their folder": (
        changed("marks", image=lambda c: "DCIM/" + c), "marks.csv, row 2: image 'DCIM/"
    ),
    "a position of no image": (
        table("gnss", lambda f: pd.concat([f, f[:1].assign(image="nope.tif")])),
        "gnss.csv, row 17: image 'nope.tif' is not in images.csv",
    ),
    "an observation twice": (
        table("tie_points", lambda f: pd.concat([f, f[:5]])), "row 896: .* stands already"
    ),
    "an image twice": (table("images", lambda f: pd.concat([f, f[:1]])), "row 17: image .* stands"),
    "a point marked twice": (table("marks", lambda f: pd.concat([f, f[:1]])), "stands already"),
    "quaternions of length 1.2": (times("images", 1.2, "qw", "qx", "qy", "qz"), "quaternion"),
    "times that stand still": (changed("images", time_s=5.0), "time_s = 5 stands still"),
    "times of the day": (changed("images", time_s="12:00:01"), "'12:00:01' is not a number"),
    "a camera of no table": (changed("images", camera="other"), "camera 'other' is not in"),
    "a position without height": (
        changed("gnss", z=lambda c: c.where(c.index != 2)), "gnss.csv, row 4: z is empty"
    ),
    "a negative focal length": (toml("f = 5489.0", "f = -5489.0"), "f = -5489 is not positive"),
    "a focal length in quotes": (toml("f = 5489.0", 'f = "5489"'), "'5489' is not a number"),
    "a focal length of any length": (toml("f = 5489.0", f"f = 1{'0' * 400}"), "f = "),
    "rows read sideways": (more('row_direction = "sideways"'), "use one of down, up, right, left"),
    "a negative readout": (more("readout_s = -0.03"), "readout_s = -0.03 is negative"),
    "a lever arm of two numbers": (more("[lever_arm]\ndefault = [0, 1]"), "not three numbers"),
    "a lever arm of no flight": (more("[lever_arm]\nF9 = [0, 0, 0]"), "names flight 'F9'"),
    "a table twice": (more("[sigma]\ntie_px = 0.5"), "block.toml, row 24: cannot declare"),
    "a key twice": (more("cx = 16.4\ncx = 16.4"), "block.toml, row"),
    "a block without a name": (toml('name = "', 'title = "'), "block has no name"),
    "cells in quotes with commas": (
        lambda folder: (folder / "gnss.csv").write_text(
            (folder / "gnss.csv").read_text().replace(",", '","')
        ),
        "columns image, z are missing",
    ),
}  # fmt: skip


@pytest.mark.parametrize("slip", REFUSED)
def test_is_refused_with_file_and_row(folder, slip):
    edit, words = REFUSED[slip]
    edit(folder)
    with pytest.raises(corridor.InputError, match=words) as refused:
        corridor.read(folder)
    assert ".csv" in str(refused.value) or "block.toml" in str(refused.value)


def test_a_sentence_is_one_line_also_of_names_with_line_breaks(folder, capsys):
    REFUSED["cells in quotes with commas"][0](folder)
    assert main(["summary", str(folder)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and len(said) < 400
