"""Ground points as other languages, programs and spreadsheets write them."""

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import convert
from corridor.core.gnss.coordinates import loosely_known
from corridor.tools.formats.ground_text import read_text
from corridor.tools.formats.plausible import _written


def table(tmp_path, *lines, encoding="utf-8"):
    path = tmp_path / "points.csv"
    path.write_text("\n".join([*lines, ""]), encoding=encoding)
    return read_text(path)


@pytest.mark.parametrize(
    "head",
    [
        "点号,X坐标,Y坐标,高程",
        "点名,北坐标(m),东坐标(m),大地高(m)",
        "점번호,X(북),Y(동),표고",
        "Nazwa,Północ,Wschód,Wysokość",
        "Punkt,Nord,Öst,Höjd",
        "Punktnavn,Nord,Øst,Høyde",
        "Vértice,N (m),E (m),h (m)",
        "Piste,Pohjoinen,Itä,Korkeus",
        "Pontszám,X (Észak),Y (Kelet),Magasság",
        "Σημείο,Βόρεια,Ανατολικά,Υψόμετρο",
        "gcp_id,coord_n,coord_e,elev_m",
    ],
)
def test_northing_easting_and_height_in_other_languages(head, tmp_path):
    found = table(tmp_path, head, "P1,5000,400,60", "P2,5001,402,63")
    assert not found.unit and found.crs is None
    assert found.table[["point", "x", "y", "z"]].iloc[0].tolist() == ["P1", 400, 5000, 60]


def test_a_unit_may_stand_behind_a_word_or_in_a_row_of_its_own(tmp_path):
    found = table(tmp_path, "Name,E,N,H,sE_mm,sN_mm,sH_mm", "P,400,5000,60,8,9,15").table
    assert found[["sx", "sy", "sz"]].iloc[0].tolist() == pytest.approx([0.008, 0.009, 0.015])
    assert table(tmp_path, "Name,E,N,Elev_ft", "P,400,5000,60").unit == "ft"
    assert table(tmp_path, "Name,E,N,H", ",ft,ft,ft", "P,400,5000,60").unit == "ft"
    assert not table(tmp_path, "Name,E,N,H", ",m,m,m", "P,400,5000,60").unit


def test_rows_and_columns_without_anything_are_passed_over(tmp_path):
    rows = ["Name,E,N,H,,", "P1,400,5000,60,,", ",,,,,", "P2,402,5001,63,,", ",,,,,"]
    assert table(tmp_path, *rows).table["point"].tolist() == ["P1", "P2"]
    rows = ["| Name | E | N | H |", "|---|--:|--:|--:|", "| P1 | 400 | 5000 | 60 |"]
    assert table(tmp_path, *rows).table["x"].tolist() == [400]


def test_text_that_a_spreadsheet_marks_and_a_typed_minus_are_read(tmp_path):
    found = table(tmp_path, "Name,E,N,H", '="001",\u2212400,5000,60').table
    assert found[["point", "x"]].iloc[0].tolist() == ["001", -400]


@pytest.mark.parametrize("nothing", ["467150.6,5428662.8,-9999", "0,0,0", "-99999,-99999,160"])
def test_what_stands_for_no_coordinate_is_none(nothing, tmp_path):
    with pytest.raises(InputError, match="line 3: point P2 has no coordinates"):
        table(tmp_path, "Name,E,N,H", "P1,467124.4,5428658.5,160.5", f"P2,{nothing}")


def test_the_origin_of_a_local_frame_may_be_a_point(tmp_path):
    for rows in (["P1,0,0,0", "P2,10,0,1"], ["P2,1000,2000,1", "P3,1400,2100,2", "P1,0,0,0"]):
        assert len(table(tmp_path, "Name,E,N,H", *rows).table) == len(rows)


def test_zeros_are_no_place_whichever_row_has_them(tmp_path):
    rows = ["P2,0,0,0", "P1,467124.4,5428658.5,160.5", "P3,467150.6,5428662.8,161.0"]
    with pytest.raises(InputError, match="line 2: point P2 has no coordinates"):
        table(tmp_path, "Name,E,N,H", *rows)
    with pytest.raises(InputError, match="line 3: point P2 has no coordinates"):
        table(tmp_path, "Name,Lat,Lon,H", "P1,49.01,8.55,160", "P2,0,0,0")


def test_names_that_differ_in_case_or_blanks_are_told(tmp_path):
    found = table(tmp_path, "Name,E,N,H", "G01,400,5000,60", "g 01,412,5000,60")
    assert any("G01, g 01 differ in case or blanks only" in note for note in found.notes)


def test_angles_that_are_no_degrees():
    """49 degrees, 0 minutes 36 seconds are 49.01 degrees; 8 degrees 33 minutes 8.55."""
    true = np.array([[-8.55, 49.01]])
    ways = dict(_written(np.array([[-833.0, 4900.6]])))
    assert next(v for k, v in ways.items() if "DDMM" in k) == pytest.approx(true)
    ways = dict(_written(np.array([[-8.33, 49.0036]])))
    assert next(v for k, v in ways.items() if "SS" in k) == pytest.approx(true)
    ways = dict(_written(np.radians(true)))
    assert next(v for k, v in ways.items() if "radians" in k) == pytest.approx(true)


def test_cgcs2000_is_wgs_84_to_two_metres_and_that_is_told():
    """False easting 500 km on the meridian of 114 degrees (EPSG:4547)."""
    place = convert(np.array([[114.0, 30.5, 40.0]]), "EPSG:4979", "EPSG:4547")
    assert place[0, [0, 2]] == pytest.approx([500_000, 40])
    assert "to 2 m only" in loosely_known(114.0, 30.5, "EPSG:4547", "EPSG:4979")


@pytest.mark.parametrize("code", ["EPSG:2334", "+proj=utm +zone=50 +ellps=GRS80 +units=m"])
def test_a_datum_that_is_another_or_unknown_is_still_refused(code):
    """Xian 1980, and an ellipsoid without a datum."""
    with pytest.raises(InputError):
        convert(np.array([[114.0, 30.5, 40.0]]), "EPSG:4979", code)
