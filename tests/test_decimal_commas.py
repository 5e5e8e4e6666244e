"""Decimal commas: read where nothing else can be meant, else refused with the remedy."""

import argparse
import re

import numpy as np
import pytest
from block_folder import block_folder

from corridor.core.block import read
from corridor.core.command.options import effect, number
from corridor.core.errors import CorridorWarning, InputError
from corridor.core.gnss import read_exposures, read_track
from corridor.core.textfile import decimal_commas, read_toml, with_point
from corridor.tools.formats.ground import read_gcp_list
from corridor.tools.formats.ground_text import read_text
from corridor.tools.thermal.series import read_series

TABLES = ("images", "tie_points", "points", "marks", "ground", "gnss", "track")


def commas(text):
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text)


@pytest.mark.parametrize(("mark", "told"), [(";", "semicolons"), ("\t", "tabs")])
@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_a_block_may_be_as_a_european_spreadsheet_saves_it(tmp_path, table, mark, told):
    folder = block_folder(tmp_path)
    plain = getattr(read(folder), table)
    path = folder / f"{table}.csv"
    text = path.read_text(encoding="utf-8")
    has = re.search(r"\d\.\d", text) is not None
    path.write_text(commas(text.replace(",", mark)), encoding="utf-8")
    with pytest.warns(CorridorWarning, match=f"{told} between the cells" + " and dec" * has):
        again = getattr(read(folder), table)
    cut = {"columns": "note", "errors": "ignore"}  # which has a comma in its text
    assert again.drop(**cut).equals(plain.drop(**cut))


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("rolling_shutter:readout=0,02", "write rolling_shutter:readout=0.02$"),
        ("gnss_bias:x=0,02,y=-1,5", "write gnss_bias:x=0.02,y=-1.5$"),
        ("readout=0,02", "write SLUG:readout=0.02$"),
        ("gnss_bias:x=0.02,y", "is not SLUG:PARAMETER=VALUE"),
    ],
)
def test_an_effect_with_a_decimal_comma_is_told_with_a_point(word, told):
    with pytest.raises(argparse.ArgumentTypeError, match=told):
        effect(word)


def test_numbers_in_quotes_may_have_decimal_commas(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text('time_s,x,y,z\n"0,5",1,"2,25",3\n"1,5","-2,75",2,"1e1"\n')
    with pytest.warns(CorridorWarning, match="track.csv was read with decimal commas"):
        table = read_track(path).table
    assert table[["time_s", "x", "y"]].to_numpy().tolist() == [[0.5, 1, 2.25], [1.5, -2.75, 2]]


@pytest.mark.parametrize(
    ("cells", "sure", "found"),
    [
        (["1", "2"], False, False),
        (["1.5", "1,234.5"], False, False),
        (["1.5", "1,234,567"], True, False),
        (["12,5", "31,958"], False, True),
        (["0,125"], False, True),
        (["467124,409"], False, True),
        (["467.124,409", "31,958"], False, True),
        (["31,958"], True, True),
        (["31,958"], False, "may have a decimal comma or be 31958"),
        (["12,5", "1.5"], True, "'12,5' has a decimal comma, and '1.5' in line 8 a decimal point"),
        (["31,958", "31.958"], True, "a decimal point"),
    ],
)
def test_what_commas_are_is_decided_from_all_numbers(tmp_path, cells, sure, found):
    numbered = list(enumerate(cells, start=7))
    if isinstance(found, bool):
        assert decimal_commas(tmp_path / "a.csv", numbered, sure) is found
    else:
        with pytest.raises(InputError, match=f"a.csv, line 7: .*{found}.*; write all numbers"):
            decimal_commas(tmp_path / "a.csv", numbered, sure)


@pytest.mark.parametrize(
    ("cell", "value"),
    [("-1,5", -1.5), (",25", 0.25), ("467.124,409", 467124.409), ("467 124,409", 467124.409),
     ("1,5e-3", 1.5e-3), ("1.5", 1.5)],
)  # fmt: skip
def test_a_decimal_comma_becomes_a_point(cell, value):
    assert float(with_point(cell)) == value


@pytest.mark.parametrize("name", ["Süd", "1,5 m"])
def test_a_name_is_no_number(name):
    assert with_point(name) == name


GROUND = {
    "semicolons": ("{p};{e};{n};{h}", ""),
    "header": ("{p};{e};{n};{h}", "Punkt;Rechtswert;Hochwert;Höhe"),
    "tabs": ("{p}\t{e}\t{n}\t{h}", ""),
    "blanks": ("{p} {e} {n} {h}", ""),
    "blanks and a header": ("{p}  {e}  {n}  {h}", "Name E N H"),
    "quotes": ('"{p}","{e}","{n}","{h}"', "Name,E,N,H"),
    "accuracies": ("{p};{e};{n};{h};0,010;0,010;0,020", "Name;E;N;H;sx;sy;sz"),
}


@pytest.mark.parametrize(("row", "head"), GROUND.values(), ids=GROUND)
def test_ground_points_may_have_decimal_commas(tmp_path, row, head):
    path = tmp_path / "points.txt"
    places = np.array([[467124.409, 5428658.56, 160.125], [467130.475, 5428688.5, -2.25]])
    rows = [row.format(p=p, e=e, n=n, h=h) for p, (e, n, h) in zip(("A", "7"), places, strict=True)]
    path.write_text("\n".join([head] * bool(head) + [commas(one) for one in rows]))
    found = read_text(path)
    assert found.table["point"].tolist() == ["A", "7"]
    assert np.array_equal(found.table[["x", "y", "z"]].to_numpy(float), places)
    assert any("decimal commas" in note for note in found.notes)
    if "sz" in head:
        assert found.table["sz"].tolist() == [0.02, 0.02]


def test_commas_between_and_in_numbers_are_refused_below_a_header_too(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("Name,E,N,H\nA,467124,409,5428658,56,160,125\nB,467130,4,5428688,5,2,25\n")
    with pytest.raises(InputError, match="line 2: commas stand both between the cells and in"):
        read_text(path)


@pytest.mark.parametrize("mark", [" ", "\t", ";"])
def test_a_gcp_list_may_have_decimal_commas(tmp_path, mark):
    path = tmp_path / "gcp_list.txt"
    rows = ["467124.5 5428658.25 160.5 252.5 80.75 a.JPG A", "467130.5 5428688 159 2 3.5 b.JPG B"]
    path.write_text("\n".join(["EPSG:25832", *(commas(r).replace(" ", mark) for r in rows)]))
    found = read_gcp_list(path)
    assert found.table[["x", "y", "z"]].to_numpy(float).tolist() == [
        [467124.5, 5428658.25, 160.5], [467130.5, 5428688, 159],
    ]  # fmt: skip
    assert found.marks == [("A", "a.JPG", 252.5, 80.75), ("B", "b.JPG", 2, 3.5)]


def test_times_of_images_may_have_decimal_commas(tmp_path):
    path = tmp_path / "images.csv"
    path.write_text("image;time_s\na.JPG;1,25\nb.JPG;2,75\n")
    with pytest.warns(CorridorWarning, match="decimal commas"):
        assert read_exposures(path).table["time_s"].tolist() == [1.25, 2.75]


def test_a_format_whose_commas_mean_something_is_named_with_the_remedy(tmp_path):
    path = tmp_path / "flight.MRK"
    path.write_text(
        "1\t202800,5\t[2314]\t0,N\t0,E\t0,V\t49,01,Lat\t8,55,Lon\t160,Ellh\t0,01, 0,01, 0,02\t50,Q"
    )
    with pytest.raises(InputError, match="looks like DJI .MRK, with decimal commas"):
        read_exposures(path)


def test_temperatures_may_have_decimal_commas(tmp_path):
    (tmp_path / "series.csv").write_text(
        "picture\ttime_s\ttemperature_c\treference\na.png\t0\t20,5\t1\nb.png\t60,0\t21,25\t0\n"
    )
    for name in "ab":
        (tmp_path / f"{name}.png").touch()
    with pytest.warns(CorridorWarning, match="tabs between the cells and decimal commas"):
        assert read_series(tmp_path).temperature_c.tolist() == [20.5, 21.25]


@pytest.mark.parametrize(
    ("text", "found"),
    [("name = 'a'\nheight_m = 50,5", "line 2: '50,5'"), ("a = [1, 0,05]", "line 1: '0,05'")],
)
def test_a_comma_in_a_plan_is_named_with_its_line(tmp_path, text, found):
    (tmp_path / "plan.toml").write_text(text)
    with pytest.raises(InputError, match=f"{found} has a decimal comma; write "):
        read_toml(tmp_path / "plan.toml")


def test_an_option_says_how_to_write_its_number():
    with pytest.raises(Exception, match="'0,02' has a decimal comma; write 0.02"):
        number("is not an accuracy", above=0.0)("0,02")
