"""Every fault of a block folder gives one sentence with the file, the row and what to do."""

import re

import numpy as np
import pandas as pd
import pytest
from block_folder import FILES, block_folder, small

from corridor.core.block import read
from corridor.core.errors import InputError

REMEDIES = (
    "add|correct|delete|fill|give|keep|measure|name|put|rename|save|separate|store|take|use|write"
)


@pytest.fixture
def folder(tmp_path):
    return block_folder(tmp_path)


def fault(folder):
    """The sentence that reading gives."""
    with pytest.raises(InputError) as caught:
        read(folder)
    sentence = str(caught.value)
    assert "\n" not in sentence and ". " not in sentence
    remedy = re.split(r"[;:] ", sentence)[-1]
    assert re.match(REMEDIES, remedy), sentence
    return sentence


# file, what stands there, what is put in its place, what the sentence must contain
SPOILT = {
    "missing column": (
        "tie_points.csv", "point,image,x,y", "point,image,x,col",
        ["tie_points.csv, row 1", "column y is missing"],
    ),
    "no cameras column": (
        "images.csv", "image,camera,", "image,kamera,", ["images.csv, row 1", "camera is missing"],
    ),
    "decimal points beside commas": (
        "gnss.csv", "007,0.1,", '007,"0,1",', ["gnss.csv, line 2", "'0,1' has a decimal comma"],
    ),
    "a column twice": ("gnss.csv", "sx,sy", "sx,sx", ["gnss.csv, row 1", "sx is there twice"]),
    "a column without a name": (
        "ground.csv", "sx,sy,sz", "sx,,sz", ["ground.csv, row 1", "column 6 has no name"],
    ),
    "unknown camera": (
        "images.csv", "i2,P1", "i2,P2",
        ["images.csv, row 3", "camera 'P2'", "[camera.P2]"],
    ),
    "no camera": ("images.csv", "i2,P1", "i2,", ["images.csv, row 3", "camera is empty"]),
    "image without a name": ("images.csv", "i2,P1", ",P1", ["images.csv, row 3", "image is empty"]),
    "image twice": (
        "images.csv", "i2,P1", "007,P1", ["images.csv, row 3", "'007'", "images.csv, row 2"],
    ),
    "unknown image in tie_points": (
        "tie_points.csv", "01,i2", "01,i9", ["tie_points.csv, row 5", "image 'i9'"],
    ),
    "unknown image in marks": (
        "marks.csv", "G1,i2", "G1,I2", ["marks.csv, row 3", "image 'I2'"],
    ),
    "unknown image in gnss": ("gnss.csv", "i2,", "i9,", ["gnss.csv, row 3", "image 'i9'"]),
    "blank in a name": ("marks.csv", "G1,i2", "G1, i2", ["marks.csv, row 3", "' i2'", "blanks"]),
    "nan": (
        "tie_points.csv", "1,i3,500,400", "1,i3,nan,400",
        ["tie_points.csv, row 6", "x = 'nan'", "delete the row"],
    ),
    "NaN in an optional column": (
        "images.csv", "A,1,12.5", "A,1,NaN",
        ["images.csv, row 3", "time_s = 'NaN'", "leave the cell empty"],
    ),
    "inf": ("points.csv", "01,10,0,0", "01,10,-inf,0", ["points.csv, row 3", "y = '-inf'"]),
    "too large a number": (
        "points.csv", "01,10,0,0", "01,10,1e999,0", ["points.csv, row 3", "y = '1e999'"],
    ),
    "text": ("ground.csv", "G1,1,2", "G1,abc,2", ["ground.csv, row 2", "x = 'abc'"]),
    "a comma that may be one of thousands": (
        "marks.csv", "G1,i2,300", 'G1,i2,"3,000"', ["marks.csv, line 3", "'3,000' may", "3000"],
    ),
    "decimal comma without quotes": (
        "marks.csv", "G1,i2,300", "G1,i2,300,5",
        ["marks.csv, row 3", "5 cells where the header has 4", "decimal point"],
    ),
    "too few cells": (
        "tie_points.csv", "1,i3,500,400,", "1,i3,500",
        ["tie_points.csv, row 6", "3 cells where the header has 5"],
    ),
    "empty needed number": (
        "tie_points.csv", "1,i3,500,", "1,i3,,", ["tie_points.csv, row 6", "x is empty"],
    ),
    "empty coordinate of a ground point": (
        "ground.csv", "G1,1,2,3", "G1,1,2,", ["ground.csv, row 2", "z is empty"],
    ),
    "observation twice": (
        "tie_points.csv", "once,i3", "1,i3",
        ["tie_points.csv, row 7", "point '1'", "'i3'", "tie_points.csv, row 6", "delete"],
    ),
    "mark twice": ("marks.csv", "G1,i2", "G1,007", ["marks.csv, row 3", "marks.csv, row 2"]),
    "gnss twice": ("gnss.csv", "i2,", "007,", ["gnss.csv, row 3", "'007'", "gnss.csv, row 2"]),
    "point twice": ("points.csv", "once", "1", ["points.csv, row 4", "points.csv, row 2"]),
    "ground point twice": ("ground.csv", "G2", "G1", ["ground.csv, row 3", "ground.csv, row 2"]),
    "ground point among the tie points": (
        "tie_points.csv", "once,", "G1,", ["marks.csv, row 2", "'G1'", "tie_points.csv"],
    ),
    "quaternion of length zero": (
        "images.csv", "20,0,100,0,1,0,0", "20,0,100,0,0,0,0",
        ["images.csv, row 3", "length zero", "unit quaternion"],
    ),
    "quaternion far from unit": (
        "images.csv", "20,0,100,0,1,0,0", "20,0,100,0,1.02,0,0",
        ["images.csv, row 3", "length 1.02"],
    ),
    "pose given in part": (
        "images.csv", "20,0,100,0,1,0,0", "20,0,100,,,,",
        ["images.csv, row 3", "the pose is given in part", "qw, qx, qy, qz are missing"],
    ),
    "velocity given in part": (
        "images.csv", "5,0,0,cloudy", "5,,0,cloudy", ["images.csv, row 2", "vy is missing"],
    ),
    "point given in part": (
        "points.csv", "01,10,0,0", "01,10,0,", ["points.csv, row 3", "z is missing"],
    ),
    "sigma of zero": (
        "tie_points.csv", "0.4", "0", ["tie_points.csv, row 3", "sigma = 0", "positive"],
    ),
    "negative sigma": ("ground.csv", "0.01,0.01,", "0.01,-1,", ["ground.csv, row 2", "sy = -1"]),
    "unknown role": (
        "ground.csv", "check", "seen", ["ground.csv, row 3", "'seen'", "control, check, unused"],
    ),
    "no role": ("ground.csv", ",check", ",", ["ground.csv, row 3", "role is empty"]),
    "time of images stands still": (
        "images.csv", "12.5", "10.5", ["images.csv, row 3", "time_s = 10.5 stands still"],
    ),
    "time of the gyroscope stands still": (
        "rates.csv", "11,", "10,", ["rates.csv, row 3", "time_s = 10.0", "rates.csv, row 2"],
    ),
    "time of the track stands still": (
        "track.csv", "11,", "10,", ["track.csv, row 3", "track.csv, row 2"],
    ),
    "epoch without a time": ("track.csv", "11,", ",", ["track.csv, row 3", "time_s is empty"]),
    "no name": ("block.toml", 'name = "two strips"', "", ["block.toml", 'name = "..."']),
    "name is a number": (
        "block.toml", '"two strips"', "2", ["block.toml, row 1", "name is not text"],
    ),
    "no width": (
        "block.toml", "width = 4000\n", "", ["block.toml, row 8", "[camera.P1]", "width"],
    ),
    "no focal length": (
        "block.toml", "f = 900.0\n", "", ["block.toml, row 16", "[camera.old camera]", "no f"],
    ),
    "width as text": (
        "block.toml", "width = 4000", 'width = "4000"', ["block.toml, row 8", "width"],
    ),
    "unknown row direction": (
        "block.toml", "k1 = -0.05", 'row_direction = "sideways"',
        ["block.toml, row 8", "row_direction", "down, up, right, left"],
    ),
    "camera without a name": (
        "block.toml", "[camera.P1]\n", "[camera]\n", ["block.toml", "[camera.NAME]"],
    ),
    "toml syntax": ("block.toml", "k1 = -0.05", "k1 = -0,05", ["block.toml, row 12"]),
    "toml cut off": ("block.toml", 'name = "Ada"\n', 'name = "Ada', ["block.toml, row 32"]),
    "offset of two numbers": (
        "block.toml", ", 0.1]", "]", ["block.toml, row 5", "offset is not three numbers"],
    ),
    "unknown sigma": (
        "block.toml", "tie_px", "tie_pixels", ["block.toml, row 23", "tie_pixels", "tie_px"],
    ),
    "default sigma of zero": (
        "block.toml", "tie_px = 0.7", "tie_px = 0", ["block.toml, row 23", "not positive"],
    ),
    "default sigma as text": (
        "block.toml", "gnss_m = 0.03", 'gnss_m = "3 cm"', ["block.toml, row 24", "gnss_m"],
    ),
    "default sigma of two numbers": (
        "block.toml", "gnss_m = 0.03", "gnss_m = [1, 2]", ["block.toml, row 24", "three numbers"],
    ),
    "lever arm of an unknown flight": (
        "block.toml", "B = [0.0", "C = [0.0", ["block.toml", "flight 'C'", "A, B"],
    ),
    "lever arm of two numbers": (
        "block.toml", "[0.0, 0.0, 0.5]", "[0.0, 0.5]", ["block.toml, row 28", "three numbers"],
    ),
    "lever arm with a unit": (
        "block.toml", "fixed = true", 'unit = "mm"', ["block.toml, row 29", "arms are in metres"],
    ),
    "fixed as text": (
        "block.toml", "fixed = true", 'fixed = "yes"', ["block.toml, row 29", "true nor false"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", SPOILT)
def test_a_fault_is_named_with_its_row_and_a_remedy(folder, what):
    file, old, new, expected = SPOILT[what]
    text = FILES[file]
    assert old in text
    text = text.replace(old, new) if old == "," else text.replace(old, new, 1)
    (folder / file).write_text(text, encoding="utf-8")
    sentence = fault(folder)
    for part in expected:
        assert part in sentence, sentence


def test_the_unspoilt_block_is_accepted(folder):
    read(folder)


def test_no_such_folder(tmp_path):
    assert "there is no such folder" in fault(tmp_path / "gone")


@pytest.mark.parametrize("file", ["block.toml", "images.csv"])
def test_a_needed_file_is_missing(folder, file):
    (folder / file).unlink()
    assert f"{file} is missing" in fault(folder)


def test_no_camera_at_all(folder):
    (folder / "block.toml").write_text('name = "x"\n')
    assert fault(folder).startswith("block.toml: there is no camera; add a table [camera.NAME]")


def test_no_observations_at_all(folder):
    for file in ("tie_points.csv", "marks.csv"):
        (folder / file).unlink()
    assert "neither holds an observation" in fault(folder)


def test_headers_alone_are_no_observations(folder):
    for file in ("tie_points.csv", "marks.csv"):
        (folder / file).write_text("point,image,x,y\n")
    assert "neither holds an observation" in fault(folder)


def test_no_images(folder):
    (folder / "images.csv").write_text("image,camera\n")
    assert fault(folder).startswith("images.csv: it names no image")


def test_an_empty_file(folder):
    (folder / "gnss.csv").write_text("")
    assert fault(folder).startswith("gnss.csv is empty")


def test_a_table_both_as_csv_and_parquet(folder):
    pd.DataFrame({"point": ["1"]}).to_parquet(folder / "points.parquet")
    assert fault(folder) == "points.csv and points.parquet are both there; keep one of them"


def test_text_of_a_western_code_page_is_read_and_told(folder):
    text = FILES["images.csv"].replace("cloudy", "wolkig in Köln")
    (folder / "images.csv").write_bytes(text.encode("cp1252"))
    with pytest.warns(RuntimeWarning, match=r"images.csv, line 2: .* Windows-1252 \('Köln'\)"):
        block = read(folder)
    assert "wolkig in Köln" in block.images.to_string()


def test_utf_16_is_read(folder):
    (folder / "images.csv").write_bytes(FILES["images.csv"].encode("utf-16"))
    count = FILES["images.csv"].strip().count("\n")
    assert len(read(folder).images) == count


def test_text_of_another_code_page_is_refused_with_its_line(folder):
    text = FILES["images.csv"].replace("cloudy", "пасмурно")
    (folder / "images.csv").write_bytes(text.encode("cp1251"))
    sentence = fault(folder)
    assert sentence.startswith("images.csv, line 2: ") and "save the file as UTF-8" in sentence


def test_rows_are_counted_through_blank_lines(folder):
    text = FILES["tie_points.csv"].replace("\n", "\n\n").replace("1,i3,500", "1,i3,nan")
    (folder / "tie_points.csv").write_text(text)
    assert "tie_points.csv, row 11: x = 'nan'" in fault(folder)


def test_rows_of_a_parquet_file_are_counted_from_one(folder):
    (folder / "marks.csv").unlink()
    marks = {"point": ["G1", "G2"], "image": ["007", "i9"], "x": 1.0, "y": 2.0}
    pd.DataFrame(marks).to_parquet(folder / "marks.parquet")
    assert "marks.parquet, row 2: image 'i9'" in fault(folder)


@pytest.mark.parametrize(
    ("column", "values", "expected"),
    [
        ("x", ["1", "2"], "column x holds"),
        ("image", [1.5, 2.5], "column image holds double; store names as text"),
        ("y", [np.nan, np.nan], "row 1: y is empty"),
        ("y", [np.inf, 1.0], "row 1: y is infinite"),
    ],
)
def test_wrong_types_in_a_parquet_file(folder, column, values, expected):
    (folder / "marks.csv").unlink()
    marks = {"point": ["G1", "G2"], "image": ["007", "i2"], "x": [1.0, 3.0], "y": [2.0, 2.0]}
    pd.DataFrame(marks | {column: values}).to_parquet(folder / "marks.parquet")
    sentence = fault(folder)
    assert sentence.startswith("marks.parquet") and expected in sentence


def test_a_parquet_file_that_is_none(folder):
    (folder / "points.csv").rename(folder / "points.parquet")
    assert fault(folder).startswith("points.parquet is not a Parquet file")


def test_two_cameras_of_one_rig_may_take_their_images_at_one_time(folder):
    text = FILES["images.csv"].replace("12.5", "").replace("B,2,,", "B,2,10.5,")
    (folder / "images.csv").write_text(text)
    assert read(folder).column("images", "time_s")[[0, 2]].tolist() == [10.5, 10.5]


def test_epochs_may_stand_in_any_order(folder):
    header, *rows = FILES["track.csv"].splitlines()
    (folder / "track.csv").write_text("\n".join([header, *reversed(rows)]))
    assert read(folder).track["time_s"].tolist() == [10.0, 11.0, 10.0]


def test_a_table_made_in_memory_is_held_to_the_same():
    with pytest.raises(InputError, match=r"images\.csv, row 1: column camera is missing"):
        small(images=pd.DataFrame({"image": ["a"]}))
    with pytest.raises(InputError, match=r"points\.csv, row 3: x = 'two' is not a number"):
        small(points=pd.DataFrame({"point": list("pq"), "x": ["1", "two"], "y": 0, "z": 0}))
    block = small(images=pd.DataFrame({"image": ["a"], "camera": ["c"]}))
    with pytest.raises(InputError, match=r"tie_points\.csv, row 2: image 'b' is not in"):
        block.check()


def test_a_parquet_file_of_more_rows_than_bytes_is_refused_before_it_is_read(folder):
    """Two million equal rows are packed to some kilobytes; two billion hardly take more."""
    (folder / "marks.csv").unlink()
    rows = pd.DataFrame({"point": "G1", "image": "007", "x": 1.0, "y": 2.0}, index=range(2_000_000))
    rows.to_parquet(folder / "marks.parquet")
    assert "marks.parquet says that it has 2,000,000 rows, more than bytes" in fault(folder)


def test_an_attitude_of_length_zero_is_refused_as_a_pose_is():
    """A traceback of SciPy before."""
    attitudes = pd.DataFrame({"image": ["a"], "qw": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0})
    with pytest.raises(InputError, match=r"attitudes\.csv, row 2: the quaternion .* length zero"):
        small(attitudes=attitudes).check()


def test_a_header_of_attitudes_that_is_not_known_is_shown():
    attitudes = pd.DataFrame({"image": ["a"], "roll_deg": 0.0, "pitch_deg": 0.0, "yaw_deg": 0.0})
    with pytest.raises(InputError, match=r"it has image, roll_deg, pitch_deg, yaw_deg"):
        small(attitudes=attitudes).check()


def test_a_flight_may_be_called_as_if_it_were_a_unit(folder):
    for name in ("images.csv", "block.toml"):
        text = (folder / name).read_text(encoding="utf-8")
        text = re.sub(r"(?m)(^B(?= =)|,B(?=,|$))", lambda m: m[0].replace("B", "unit_m"), text)
        (folder / name).write_text(text, encoding="utf-8")
    assert "unit_m" in read(folder).lever_arm
