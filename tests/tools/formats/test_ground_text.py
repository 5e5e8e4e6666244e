"""Ground points in every form in which surveyors write them, and forms that are refused."""

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Local, convert
from corridor.tools.formats import (
    Additions,
    add_ground,
    complete,
    export_project,
    import_project,
    read_gcp_list,
)
from corridor.tools.formats.frames import local_table, moved
from corridor.tools.formats.ground import read_ground
from corridor.tools.formats.ground_text import read_text, role_of
from corridor.tools.formats.names import Names
from corridor.tools.formats.project import Project

from .conftest import exact_block

PLACE = Local(49.012, 8.554, 0.0)
UTM = "EPSG:25832"


def placed(**changes):
    """A project with a place on Earth: twelve images, marks of four ground points."""
    block = exact_block(k1=-0.05)
    block.extra["local_frame"] = local_table(PLACE)
    return Project("made", None, block.select()).having(**changes)


def surveyed(project, crs=UTM):
    """Names and coordinates of its ground points in a system, without them."""
    ground = project.block.ground
    return list(ground["point"]), PLACE.to_crs(ground[["x", "y", "z"]].to_numpy(float), crs)


def as_text(names, places, form, separator=","):
    rows = [form[0]] if form[0] else []
    for name, (e, n, h) in zip(names, places, strict=True):
        rows.append(separator.join(form[1]).format(p=name, e=e, n=n, h=h))
    return "\n".join(rows) + "\n"


PENZ = ("{p}", "{e:.4f}", "{n:.4f}", "{h:.4f}")
PNEZ = ("{p}", "{n:.4f}", "{e:.4f}", "{h:.4f}")
FORMS = {
    "plain": (("", PENZ), ","),
    "semicolons": (("", PENZ), ";"),
    "tabs": (("", PENZ), "\t"),
    "blanks": (("", PENZ), " "),
    "header x y z": (("name,x,y,z", PENZ), ","),
    "northing first": (("Point,Northing,Easting,Elevation", PNEZ), ","),
    "northing first, described": (
        ("Pt;Northing [m];Easting [m];Elev. [m];Code", (*PNEZ, "target")), ";",
    ),
    "the letters of surveyors": (("PNEZD", (*PNEZ, "nail")), ","),
    "French": (("Nom;Nord;Est;Altitude", PNEZ), ";"),
    "comments of other programs": (("% Emlid\n// base A\nName,E,N,H", PENZ), ","),
    "German": (("Punktnummer;Rechtswert;Hochwert;Höhe", PENZ), ";"),
    "Metashape": (("#Label,X/Easting,Y/Northing,Z/Altitude", PENZ), ","),
    "names last": (("", (*PENZ[1:], "{p}")), ","),
    "names last, with header": (("E,N,H,Name", (*PENZ[1:], "{p}")), ","),
    "a comment before the header": (("# Leica GS18\nName,E,N,H", PENZ), ","),
    "quoted": (('"Name","E","N","H"', ('"{p}"', '"{e:.4f}"', '"{n:.4f}"', '"{h:.4f}"')), ","),
    "Leica Infinity": (("Point ID\tPoint Role\tEasting\tNorthing\tEllip. Height\t3D CQ",
                        ("{p}", "Measured", *PENZ[1:], "0.018")), "\t"),
    "Leica Captivate": (("Point ID,E,N,Ht,CQ3D,CQ2D,CQ1D", (*PENZ, "0.02", "0.01", "0.01")), ","),
    "Trimble Business Center": (
        ("Point ID,Grid Northing,Grid Easting,Grid Elevation,Feature Code", (*PNEZ, "GCP")), ",",
    ),
    "Spanish": (("Punto;Este;Norte;Cota ortométrica", PENZ), ";"),
    "Japanese, X to the north": (("点名,X座標,Y座標,標高", PNEZ), ","),
    "Chinese": (("点号,北坐标,东坐标,高程", PNEZ), ","),
    "Russian": (("Имя;Северная;Восточная;Высота", PNEZ), ";"),
    "Dutch": (("Punt;X-coordinaat;Y-coordinaat;NAP-hoogte", PENZ), ";"),
    "X to the north, said in brackets": (("Nr;X (N);Y (E);H", PNEZ), ";"),
    "the end of a text in DOS": (("Name,E,N,H", (*PENZ[:3], "{h:.4f}\n\x1a")), ","),
    "names under a word that is not known": (("Matricule;X;Y;Z", PENZ), ";"),
    "thousands": (("name;e;n;h", ("{p}", "{e:,.4f}", "{n:,.4f}", "{h:.4f}")), ";"),
}  # fmt: skip


@pytest.mark.parametrize(("form", "separator"), FORMS.values(), ids=FORMS)
def test_every_form_gives_the_same_points(tmp_path, form, separator):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    path.write_text(as_text(names, places, form, separator), encoding="utf-8")
    made = add_ground(project, path, crs=UTM).block.ground
    assert list(made["point"]) == names
    known = project.block.ground[["x", "y", "z"]].to_numpy(float)
    # Printed to a tenth of a millimetre.
    assert np.abs(made[["x", "y", "z"]].to_numpy(float) - known).max() < 2e-4


@pytest.mark.parametrize("crs", [None, "EPSG:4979", "EPSG:4326", "EPSG:4258"])
def test_latitude_and_longitude_need_no_system(tmp_path, crs):
    project = placed()
    names, places = surveyed(project, "EPSG:4979")
    rows = [f"{n},{lat:.10f},{lon:.10f},{h:.4f}" for n, (lon, lat, h) in zip(names, places)]  # noqa: B905
    path = tmp_path / "latlon.csv"
    path.write_text("\n".join(["name,lat,lon,h", *rows]) + "\n")
    made = add_ground(project, path, crs=crs).block.ground
    known = project.block.ground[["x", "y", "z"]].to_numpy(float)
    assert np.abs(made[["x", "y", "z"]].to_numpy(float) - known).max() < 2e-4


WRONG = {
    "northing first, unsaid": (("", PNEZ), UTM, "exchanged"),
    "a grid without its name": (("", PENZ), None, "--ground-crs EPSG:25832"),
    "northing first in a grid without its name": (("", PNEZ), None, "northing stands first"),
    "a zone before the easting": (
        ("", ("{p}", "32{e:.4f}", "{n:.4f}", "{h:.4f}")), UTM, "number of the zone",
    ),
    "another zone": (("", PENZ), "EPSG:25835", "those of EPSG:25832: write that in"),
    "unknown words": (("name,alpha,beta,gamma", PENZ), UTM, "does not name the coordinates"),
    "another half of the Earth": (("", PENZ), "EPSG:32732", "those of EPSG:25832: write that in"),
    "no height": (("name,easting,northing", PENZ[:3]), UTM, "names no height"),
    "a height of an unknown word": (("name,E,N,undulation", PENZ), UTM, "undulation.* no height"),
    "two eastings": (("name,x,easting,z", PENZ), UTM, "two columns"),
    "a system in each row": (("", ("EPSG:25832", *PENZ)), UTM, "write it once"),
    "decimal commas between commas": (
        ("", ("{p}", "{e:.0f},5", "{n:.0f},5", "{h:.0f},5")), UTM, "decimal point",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("form", "crs", "said"), WRONG.values(), ids=WRONG)
def test_what_cannot_be_meant_is_refused_with_its_remedy(tmp_path, form, crs, said):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    path.write_text(as_text(names, places, form), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        add_ground(project, path, crs=crs)


def angle(degrees, halves, form):
    """An angle as tables have it: 49 00 43.2 N, 49°00'43.2"N, N 49.012."""
    whole = int(abs(degrees) * 3600e6 + 0.5) / 1e6
    minutes, seconds = divmod(whole, 60)
    half = halves[int(degrees < 0)]
    d, m = divmod(int(minutes), 60)
    return form.format(
        half=half, sign="-" * int(degrees < 0), d=d, m=m, s=seconds, size=abs(degrees)
    )


@pytest.mark.parametrize("place", [PLACE, Local(-43.53, 172.62, 0.0), Local(-0.01, -0.02, 0.0)])
@pytest.mark.parametrize(
    "form",
    ["{d}°{m:02d}'{s:09.6f}\"{half}", "{sign}{d} {m:02d} {s:09.6f}", "{half} {size:.10f}",
     "{size:.10f}° {half}", "{d}:{m:02d}:{s:.6f} {half}"],
)  # fmt: skip
def test_angles_of_every_form_and_half_of_the_earth_are_read(tmp_path, place, form):
    xyz = placed().block.ground[["x", "y", "z"]].to_numpy(float)
    lines = ["name;lat;lon;h"]
    for k, (lon, lat, h) in enumerate(place.to_geographic(xyz)):
        lines.append(f"A{k};{angle(lat, 'NS', form)};{angle(lon, 'EW', form)};{h:.4f}")
    path = tmp_path / "points.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    back = place.from_geographic(read_text(path).table[["x", "y", "z"]].to_numpy(float))
    assert np.abs(back - xyz).max() < 2e-4


def test_an_angle_of_the_other_axis_is_refused(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name,lat,lon,h\nA,8.5 E,49.1 N,100\n")
    with pytest.raises(InputError, match=r"line 2: '49.1 N' stands in the column lon"):
        read_text(path)


@pytest.mark.parametrize(
    ("head", "row"),
    [("Name,Easting,Northing,Elevation,Longitude,Latitude,Ellipsoidal height",
      "A,467000.1,5428000.2,112.3,8.55,49.01,160.2"),
     ("name,longitude,latitude,height,easting,northing,elevation",
      "A,8.55,49.01,160.2,467000.1,5428000.2,112.3"),
     ("name,lon,lat,Orthometric height,Ellipsoidal height", "A,8.55,49.01,112.3,160.2")],
    ids=["Emlid Flow", "ReachView", "two heights"],
)  # fmt: skip
def test_of_a_table_in_two_systems_one_is_read(tmp_path, head, row):
    """Heights above the ellipsoid are those that belong to latitude and longitude."""
    path = tmp_path / "points.csv"
    path.write_text(f"{head}\n{row}\n")
    found = read_text(path)
    assert found.table[["x", "y", "z"]].iloc[0].tolist() == [8.55, 49.01, 160.2]
    assert found.crs == "EPSG:4979"
    assert any("latitude and longitude were read" in n for n in found.notes) == ("asting" in head)


@pytest.mark.parametrize(
    ("head", "row", "sigmas"),
    [("name,E,N,H,sde (mm),sdn (mm),sdu [mm]", "8,9,15", [0.008, 0.009, 0.015]),
     ("name,E,N,H,Accuracy XY (cm),Accuracy Z (mm)", "1.2,20", [0.012, 0.012, 0.02]),
     ("name,E,N,H,Accuracy (mm)", "20", [0.02, 0.02, 0.02]),
     ("name,E,N,H,H. Prec,V. Prec", "0.01,0.02", [0.01, 0.01, 0.02]),
     ("name,E,N,H,Hz Prec,Vt Prec", "0.01,0.02", [0.01, 0.01, 0.02]),
     ("name,E,N,H,HRMS,VRMS", "0.01,0.02", [0.01, 0.01, 0.02]),
     ("name,E,N,H,CQ2D,CQ1D,CQ3D", "0.01,0.02,0.03", [0.01, 0.01, 0.02]),
     ("name,E,N,H,Sd. Easting [m],Sd. Northing [m],Sd. Height [m]", "0.01,0.02,0.03",
      [0.01, 0.02, 0.03]),
     ("nom,E,N,H,Précision XY,Précision Z", "0.01,0.02", [0.01, 0.01, 0.02]),
     ("name,E,N,H,Lateral RMS,Elevation RMS", "0.01,0.02", [0.01, 0.01, 0.02])],
)  # fmt: skip
def test_standard_deviations_become_metres(tmp_path, head, row, sigmas):
    path = tmp_path / "points.csv"
    path.write_text(f"{head}\nA,467000.1,5428000.2,112.3,{row}\n")
    assert read_text(path).table[["sx", "sy", "sz"]].iloc[0].tolist() == pytest.approx(sigmas)


def test_what_holds_at_95_percent_is_no_standard_deviation(tmp_path):
    path = tmp_path / "points.csv"
    head = "name,E,N,H,Horizontal Precision (95%),Vertical Precision (95%)"
    path.write_text(f"{head}\nA,467000.1,5428000.2,112.3,0.02,0.04\n")
    found = read_text(path)
    assert "sx" not in found.table and "Vertical Precision" in found.notes[0]


def test_thousands_may_stand_apart_and_minutes_behind_a_dash(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name;E;N;H\nA;467'124.4;5 428 658.5;112.3\n")
    assert read_text(path).table[["x", "y"]].iloc[0].tolist() == [467124.4, 5428658.5]
    path.write_text("name,lat,lon,h\nA,49-00-36.0N,8-33-00.0E,160.2\n")
    assert read_text(path).table[["x", "y"]].iloc[0].tolist() == pytest.approx([8.55, 49.01])


def test_the_system_that_a_table_of_metashape_states_is_read(tmp_path):
    project = placed()
    names, places = surveyed(project)
    form = ("# CoordinateSystem: EPSG:25832\n#Label,X/Easting,Y/Northing,Z/Altitude", PENZ)
    (tmp_path / "points.csv").write_text(as_text(names, places, form))
    made = add_ground(project, tmp_path / "points.csv").block.ground[["x", "y", "z"]]
    known = project.block.ground[["x", "y", "z"]].to_numpy(float)
    assert np.abs(made.to_numpy(float) - known).max() < 2e-4


def test_titles_stand_before_a_header_and_remarks_are_named_with_their_line(tmp_path):
    path = tmp_path / "points.csv"
    text = "Project: Bridge 12\nSurveyor; J. Doe\n\nPoint,Easting,Northing,Height\n"
    text += "A,467000.1,5428000.2,112.3\nB,467000.1,5428000.2,113.3\n"
    path.write_text(text)
    assert read_text(path).table["z"].tolist() == [112.3, 113.3]
    path.write_text(text + "Total: 2 points\n")
    with pytest.raises(InputError, match="line 7: 1 cells where a name"):
        read_text(path)
    path.write_text(text + "C,,,\n")
    with pytest.raises(InputError, match="line 7: 1 cells where a name"):
        read_text(path)


def test_the_sign_of_a_latitude_that_was_lost_is_named(tmp_path):
    south = Local(-43.53, 172.62, 0.0)
    project = Project("made", None, exact_block(k1=-0.05).select())
    project.block.extra["local_frame"] = local_table(south)
    ground = project.block.ground
    path = tmp_path / "points.csv"
    for signs, said in (([1, -1, 1], "sign of the latitude"), ([-1, 1, 1], "sign of the longit")):
        places = south.to_geographic(ground[["x", "y", "z"]].to_numpy(float)) * signs
        rows = [f"{n},{b:.9f},{a:.9f},{h:.3f}" for n, (a, b, h) in zip(ground["point"], places)]  # noqa: B905
        path.write_text("\n".join(["name,lat,lon,h", *rows]))
        with pytest.raises(InputError, match=said):
            add_ground(project, path)


def test_degrees_beyond_ninety_without_a_header_are_known(tmp_path):
    east = Local(-43.53, 172.62, 0.0)
    project = Project("made", None, exact_block(k1=-0.05).select())
    project.block.extra["local_frame"] = local_table(east)
    ground = project.block.ground
    places = east.to_geographic(ground[["x", "y", "z"]].to_numpy(float))
    rows = [f"{n},{b:.9f},{a:.9f},{h:.3f}" for n, (a, b, h) in zip(ground["point"], places)]  # noqa: B905
    (tmp_path / "points.csv").write_text("\n".join(rows))
    with pytest.raises(InputError, match="are latitude and longitude: name the columns"):
        add_ground(project, tmp_path / "points.csv")


def converted(places, crs):
    return convert(places, UTM, crs)


SLIPS = {
    "millimetres": (lambda p: 1000 * p, "x,y,z", "in millimetres: give metres"),
    "the zone beside": (lambda p: converted(p, "EPSG:25833"), "x,y,z", "ground-crs EPSG:25833"),
    # Its zone stands before the easting, and without it the points lie 2 km off.
    "Gauss-Krueger": (lambda p: converted(p, "EPSG:31467"), "x,y,z", "ground-crs EPSG:31467"),
    "the system of web maps": (lambda p: converted(p, "EPSG:3857"), "x,y,z", "EPSG:3857"),
    "geocentric": (lambda p: converted(p, "EPSG:4978"), "x,y,z", "ground-crs EPSG:4978"),
    "gon": (
        lambda p: converted(p, "EPSG:4979") / [0.9, 0.9, 1.0], "lon,lat,h", "in gon: give degrees",
    ),
}  # fmt: skip


@pytest.mark.parametrize("marked", [True, False])
@pytest.mark.parametrize(("change", "head", "said"), SLIPS.values(), ids=SLIPS)
def test_another_unit_or_system_is_named(tmp_path, change, head, said, marked):
    project = placed()
    names, places = surveyed(project)
    project.block.crs, project.block.offset = UTM, np.array([467000.0, 5428000.0, 0.0])
    del project.block.extra["local_frame"]
    moving = project.block.offset - places.mean(axis=0) * [1, 1, 0]
    for table in ("images", "ground", "points"):
        frame = getattr(project.block, table)
        frame[["x", "y", "z"]] -= moving
    if not marked:
        project.block.marks = project.block.marks[:0]
    rows = (f"{n},{x:.9f},{y:.9f},{z:.4f}" for n, (x, y, z) in zip(names, change(places)))  # noqa: B905
    path = tmp_path / "points.csv"
    path.write_text("\n".join([f"name,{head}", *rows]))
    with pytest.raises(InputError, match=said):
        add_ground(project, path)


def test_degrees_and_minutes_need_no_seconds(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name,lat,lon,h\nA,49 0.6,-8 33.0,160\nB,49 1.2,8 33.3,160\n")
    assert read_text(path).table["y"].tolist() == pytest.approx([49.01, 49.02])
    assert read_text(path).table["x"].tolist() == pytest.approx([-8.55, 8.555])


def test_coordinates_of_few_digits_are_told(tmp_path):
    path = tmp_path / "points.csv"
    rows = "A,{:{f}},{:{f}},112.3\nB,{:{f}},{:{f}},112.3\nC,{:{f}},{:{f}},112.3\n"
    every = (467124.409, 5428658.56, 467130.475, 5428688.519, 467150.647, 5428662.853)
    for form, step in ((".0f", "1"), (".1f", "0.1"), (".3f", "")):
        path.write_text("name,E,N,H\n" + rows.format(*every, f=form))
        told = [note for note in read_text(path).notes if "in steps of" in note]
        assert len(told) == (step != "") and (not step or f"steps of {step} m, so" in told[0])
    path.write_text("name,E,N,H\n" + rows.format(*every, f=".2E"))
    with pytest.raises(InputError, match=r"line 2: 4.67E\+05 is cut to 1000 m: a spreadsheet"):
        read_text(path)
    path.write_text("name,E,N,H\n" + rows.format(*every, f=".9E"))
    assert not read_text(path).notes
    # Targets on a wall.
    path.write_text("name,x,y,z\nA,0,0,0\nB,1,0,0\nC,1,2,0\n")
    assert not read_text(path).notes


def test_points_that_are_switched_off_are_check_points(tmp_path):
    path = tmp_path / "points.csv"
    head = "#Label,X/Easting,Y/Northing,Z/Altitude,Enabled,Accuracy"
    path.write_text(f"{head}\nA,467124.4,5428658.5,1.5,1,0.02\nB,467130.4,5428688.5,1.5,0,0.02\n")
    found = read_text(path)
    assert found.table["role"].tolist() == ["control", "check"]
    assert any("1 points are switched off (Enabled)" in note for note in found.notes)


@pytest.mark.parametrize("foot", [0.3048, 1200 / 3937], ids=["feet", "US survey feet"])
def test_feet_are_known_by_their_ratio(tmp_path, foot):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    path.write_text(as_text(names, places / foot, ("", PENZ)))
    with pytest.raises(InputError, match="feet"):
        add_ground(project, path, crs=UTM)


@pytest.mark.parametrize(
    ("unit", "said"),
    [("(ft)", "in ft"), ("[US ft]", "in US ft"), ("[mm]", "in mm"), ("(Feet)", "in Feet"),
     ("[m]", ""), ("(WGS84)", ""), ("(metres)", "")],
)  # fmt: skip
def test_a_unit_of_the_header_is_read(tmp_path, unit, said):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    header = f"Point,Easting {unit},Northing {unit},Elevation {unit}"
    path.write_text(as_text(names, places, (header, PENZ)))
    if said:
        with pytest.raises(InputError, match=f"points.csv: its header .* {said}; write them in"):
            add_ground(project, path, crs=UTM)
    else:
        assert len(add_ground(project, path, crs=UTM).block.ground) == len(names)


@pytest.mark.parametrize("write", [str.lower, lambda name: f" {name[:3]} {name[3:]}"])
@pytest.mark.parametrize("head", ["point,x,y,z", "Name,E,N,H"])
def test_points_whose_names_differ_in_case_and_blanks_are_those_of_the_marks(tmp_path, write, head):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    path.write_text(as_text(map(write, names), places, (head, PENZ)))
    made = add_ground(project, path, crs=UTM)
    assert list(made.block.ground["point"]) == names
    assert any("differ in case or blanks" in told for told in made.notes)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [("a.kml", "<kml/>", "a.kml is a map"), ("a.gsi", "*110001+A 81..10+1\n", "instrument"),
     ("a.txt", "*110001+0000000000000A1 81..10+0000000001000000\n", "instrument"),
     ("a.xml", "<?xml version='1.0'?><LandXML><CgPoints/></LandXML>", "instrument"),
     ("a.json", '{"type": "FeatureCollection", "features": []}', "is a map"),
     ("a.csv", "PK\3\4xl/workbook.xml", "is an Excel workbook"),
     ("a.csv", "<!DOCTYPE html><html>", "page of the web"),
     ("a.xlsx", "PK", "Excel"), ("a.geojson", "{}", "is a map"),
     ("a.csv", "point,x,y,z,role\nA,1,2,3,\nB,1,2,3,maybe\n", "a.csv, line 3: role 'maybe'"),
     ("a.csv", "point,x,y,z\nA,1,2,3\nB,1,2,3\nA,1,2,4\n", "twice, as point 1 and 3"),
     ("a.csv", "name,x,y,z\nA,1,2,3\nA,1,2,4\n", "twice, as point 1 and 2")],
)  # fmt: skip
def test_what_is_no_list_of_points_is_called_what_it_is(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        add_ground(placed(), tmp_path / name)


@pytest.mark.parametrize(("factor", "unit"), [(1000, "millimetres"), (1 / 0.3048, "feet"), (1, "")])
def test_a_project_with_positions_tells_the_unit_of_control(tmp_path, factor, unit):
    project = Project("made", None, exact_block().select())
    ground, images = project.block.ground, project.block.images
    gnss = images[["image", "x", "y", "z"]].assign(sx=0.02, sy=0.02, sz=0.03)
    project = project.having(gnss=gnss, placed=False)
    path = tmp_path / "points.csv"
    places = factor * ground[["x", "y", "z"]].to_numpy(float)
    path.write_text(as_text(list(ground["point"]), places, ("point,x,y,z", PENZ)))
    told = [w for w in add_ground(project, path).warnings if "times as large" in w]
    assert [f"are they in {unit}?" in one for one in told] == ([True] if unit else [])


def test_heights_above_the_geoid_are_told_with_their_difference(tmp_path):
    project = placed()
    names, places = surveyed(project)
    path = tmp_path / "points.csv"
    path.write_text(as_text(names, places - [0, 0, 47.9], ("", PENZ)))
    made = add_ground(project, path, crs=UTM)
    assert any("47.9 m below" in told and "another height system" in told for told in made.notes)


def test_points_far_away_are_noticed_without_marks(tmp_path):
    project = placed(marks=exact_block().marks[:0])
    names, places = surveyed(project, "EPSG:4979")
    rows = [f"{n},{lon:.9f},{lat:.9f},{h:.3f}" for n, (lon, lat, h) in zip(names, places)]  # noqa: B905
    path = tmp_path / "swapped.csv"
    # Columns are named the wrong way round: 5,600 km away.
    path.write_text("\n".join(["name,lat,lon,h", *rows]) + "\n")
    with pytest.raises(InputError, match="latitude and longitude are exchanged"):
        add_ground(project, path)


@pytest.mark.parametrize("swapped", [False, True])
def test_degrees_taken_for_metres_beside_the_origin_are_noticed(tmp_path, swapped):
    """49.01, 8.55 lies 50 m from the origin of a local frame, too; but all are on one spot."""
    project = placed()
    names = ["A1", "A2", "A3"]
    ground = project.block.ground[["x", "y", "z"]].to_numpy(float)[:3]
    lon, lat, height = PLACE.to_geographic(ground).T
    first, second = (lon, lat) if swapped else (lat, lon)
    rows = zip(names, first, second, height, strict=True)
    text = "".join(f"{n},{a:.8f},{b:.8f},{h:.3f}\n" for n, a, b, h in rows)
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InputError, match="the coordinates are l.*within .* m of each other"):
        add_ground(project, tmp_path / "points.csv")


def test_a_list_of_control_beside_a_project_is_named(tmp_path):
    export_project(placed().block, "opensfm", tmp_path / "odm" / "opensfm", lossy=True)
    (tmp_path / "odm" / "gcp_list.txt").write_text("EPSG:25832\n1 2 3 4 5 a.jpg\n")
    made = import_project(tmp_path / "odm" / "opensfm", "auto", tmp_path / "block")
    assert any("give it with --ground" in told for told in made.project.warnings)


def test_names_with_blanks_and_sigmas_and_roles_are_kept(tmp_path):
    path = tmp_path / "g.txt"
    path.write_text("GCP 1 10.0 20.0 1.0\nGCP 2 11.0 21.0 1.5\n")
    assert list(read_text(path).table["point"]) == ["GCP 1", "GCP 2"]
    path.write_text("Name,x,y,z,sx,sy,sz,role\nA,1.0,2.0,3.0,0.01,0.02,0.03,Check\n")
    row = read_text(path).table.iloc[0]
    assert row[["sx", "sy", "sz"]].tolist() == [0.01, 0.02, 0.03] and row["role"] == "check"
    path.write_text("Name;E;N;H;Accuracy XY;Accuracy Z\nA;1.0;2.0;3.0;0.02;0.04\n")
    assert read_text(path).table[["sx", "sy", "sz"]].iloc[0].tolist() == [0.02, 0.02, 0.04]
    path.write_text("A 1.0 2.0 3.0 0.01 0.01 0.02\n")
    assert read_text(path).table["sz"].tolist() == [0.02]


@pytest.mark.parametrize(
    ("text", "role"),
    [("Control", "control"), ("CHECK", "check"), ("", "control"), ("check point", "check"),
     ("GCP", "control"), ("unused ", "unused"), ("CP", None)],
)  # fmt: skip
def test_roles_in_any_case(text, role):
    assert role_of(text) == role


def gcp_list(project, head, change=lambda image: image, places=lambda xyz: xyz):
    ground = project.block.ground.set_index("point")[["x", "y", "z"]]
    rows = [head]
    marks = project.block.marks.astype({"point": str, "image": str})
    for point, image, x, y in marks[["point", "image", "x", "y"]].itertuples(index=False):
        if point in ground.index:
            xyz = PLACE.to_crs(ground.loc[[point]].to_numpy(float), UTM)
            e, n, h = places(xyz)[0]
            rows.append(f"{e:.4f} {n:.4f} {h:.4f} {x:.3f} {y:.3f} {change(image)} {point}")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    "change",
    [str.lower, str.upper, lambda n: n.rpartition(".")[0], lambda n: f"DCIM/{n}",
     lambda n: f"D:\\flight\\{n}", lambda n: n.replace(".JPG", ".jpeg"),
     lambda n: f'"my flight/{n}"'],
    ids=["lower case", "upper case", "without ending", "folder", "folder of Windows", "ending",
         "quotes"],
)  # fmt: skip
def test_names_of_images_that_differ_are_matched_and_told(tmp_path, change):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, UTM, change))
    bare = project.having(marks=project.block.marks[:0], ground=project.block.ground[:0])
    made = add_ground(bare, path)
    lost = project.block.marks["point"].isin(project.block.ground["point"]).sum()
    assert len(made.block.marks) == lost
    if change("IMG_0001.JPG") != "IMG_0001.JPG":
        assert any("matched" in note for note in made.notes)


def test_marks_of_other_images_are_never_dropped_in_silence(tmp_path):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, UTM, lambda name: f"X{name}"))
    with pytest.raises(InputError, match="correct the names"):
        add_ground(project, path)
    path.write_text(gcp_list(project, UTM, lambda n: "other.jpg" if n == "IMG_0000.JPG" else n))
    made = add_ground(project, path)
    assert any("left out: other.jpg" in told for told in made.warnings)


def test_umlauts_of_macos_are_the_same_name():
    names = Names(["S\u00fcd/DJI_0001.JPG", "Nord/DJI_0001.JPG"])
    assert names.row("Su\u0308d/DJI_0001.JPG") == 0
    assert names.row("DJI_0001.JPG") is None  # could be two


@pytest.mark.parametrize(
    "head",
    [UTM, "# made by hand\n\nEPSG:25832", "epsg:25832", "WGS84 UTM 32N", "25832", "EPSG 25832",
     "ETRS89 / UTM zone 32N", "urn:ogc:def:crs:EPSG::25832", "% base A\nEPSG:25832",
     "// base A\nEPSG:25832", "; base A\nEPSG:25832",
     "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs"],
)  # fmt: skip
def test_first_lines_of_gcp_lists_that_name_a_system(tmp_path, head):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, head))
    assert len(read_gcp_list(path).table) == len(project.block.ground)
    assert read_ground(path, project.block).crs is not None


@pytest.mark.parametrize(
    ("head", "said"),
    [("WGS84", "EPSG:4326"), ("WGS84 longlat", "EPSG:4326"), ("local", "names no coordinate"),
     ("UTM / zone 32N", "names no coordinate"),
     ("EPSG:25832+7837", "de_bkg_gcg2016|ground points")],
)  # fmt: skip
def test_first_lines_that_name_none_say_what_to_write(tmp_path, head, said):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, head))
    with pytest.raises(InputError, match=said):
        add_ground(project, path)


@pytest.mark.parametrize("row", ["P1,DJI_0001.JPG,10.5,20.5", "DJI_0001.JPG,P1,10.5,20.5"])
def test_a_table_of_marks_is_called_what_it_is(tmp_path, row):
    (tmp_path / "marks.txt").write_text(f"{row}\n{row.replace('P1', 'P2')}\n")
    with pytest.raises(InputError, match=r"marks.txt, line 1: .*where points are seen"):
        read_text(tmp_path / "marks.txt")


def test_a_gcp_list_with_commas_is_the_same_list(tmp_path):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, UTM))
    plain = read_gcp_list(path)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([head, *(",".join(row.split()) for row in rows)]))
    again = read_gcp_list(path)
    assert again.marks == plain.marks and again.table.equals(plain.table)


def test_marks_outside_their_pictures_are_told(tmp_path):
    project = placed()
    names, places = surveyed(project)
    marks = project.block.marks[project.block.marks["point"] == names[0]]
    image, width = marks["image"].iloc[0], next(iter(project.block.cameras.values())).width
    x, y, z = places[0]
    row = f"{x:.4f} {y:.4f} {z:.4f} {width + 50} 20 {image} far\n"
    (tmp_path / "gcp_list.txt").write_text(f"{UTM}\n{row}")
    made = add_ground(project, tmp_path / "gcp_list.txt")
    assert "1 of 1 marks" in made.warnings[-1] and f"far in {image} at" in made.warnings[-1]


def test_exchanged_axes_of_a_gcp_list_are_told_by_its_marks(tmp_path):
    project = placed()
    path = tmp_path / "gcp_list.txt"
    path.write_text(gcp_list(project, UTM, places=lambda xyz: xyz[:, [1, 0, 2]]))
    with pytest.raises(InputError, match="exchanged"):
        add_ground(project, path)


# --- systems ---------------------------------------------------------------------------------


def test_crs_converts_a_project_that_has_a_place():
    project = complete(placed(), Additions(crs=UTM))
    block = project.block
    world = block.images[["x", "y", "z"]].to_numpy(float) + block.offset
    known = PLACE.to_crs(placed().block.images[["x", "y", "z"]].to_numpy(float), UTM)
    assert block.crs == UTM and "local_frame" not in block.extra
    assert np.abs(world - known).max() < 1e-6
    assert any("converted" in note for note in project.notes)


def test_a_system_whose_datum_is_joined_loosely_is_told_with_what_joins_it_better():
    project = complete(placed(), Additions(crs="EPSG:31467"))
    assert any("EPSG:31467 and WGS 84 to 3 m only" in told for told in project.warnings)
    assert not any("m only" in told for told in complete(placed(), Additions(crs=UTM)).warnings)


@pytest.mark.parametrize("form", ["WKT1_ESRI", "WKT1_GDAL", "WKT2_2019"])
def test_a_prj_beside_a_table_says_its_system(tmp_path, form):
    pyproj = pytest.importorskip("pyproj")
    project = placed()
    names, places = surveyed(project)
    (tmp_path / "points.csv").write_text(as_text(names, places, ("", PENZ)))
    (tmp_path / "points.prj").write_text(pyproj.CRS(UTM).to_wkt(form))
    for crs in (None, UTM):
        made = add_ground(project, tmp_path / "points.csv", crs=crs)
        known = project.block.ground[["x", "y", "z"]].to_numpy(float)
        assert np.abs(made.block.ground[["x", "y", "z"]].to_numpy(float) - known).max() < 2e-4
        assert any("read from points.prj: ETRS89 / UTM zone 32N" in note for note in made.notes)
    with pytest.raises(InputError, match="contradicts it"):
        add_ground(project, tmp_path / "points.csv", crs="EPSG:25833")


def test_a_prj_that_names_no_system_is_told(tmp_path):
    (tmp_path / "points.csv").write_text("A,1,2,3\n")
    (tmp_path / "points.prj").write_text("Lambert, I think")
    with pytest.raises(InputError, match=r"points.prj names no coordinate system that is known"):
        add_ground(placed(), tmp_path / "points.csv")


def test_a_prj_beside_a_project_without_a_system_is_named(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    export_project(exact_block(), "colmap-text", tmp_path / "model")
    (tmp_path / "model" / "site.prj").write_text(pyproj.CRS(UTM).to_wkt("WKT1_ESRI"))
    made = import_project(tmp_path / "model", "auto", tmp_path / "out").project
    assert any("site.prj beside the project names ETRS89" in one for one in made.warnings)


def test_crs_never_labels_what_is_not_in_it():
    project = placed()
    project.block.extra.pop("local_frame")
    with pytest.raises(InputError, match="coordinates are not in it"):
        complete(project, Additions(crs=UTM))


@pytest.mark.parametrize("crs", ["EPSG:25831", "EPSG:2154", "EPSG:25833", "EPSG:32632"])
def test_there_and_back_again_changes_nothing(crs):
    block = placed().block
    back = moved(moved(block, crs), PLACE)
    for table in ("images", "points", "ground"):
        xyz = back.numbers(table, *"xyz") - block.numbers(table, *"xyz")
        assert np.abs(xyz).max() < 1e-6
    # Grids are conformal but for heights: axes stay perpendicular to the scale times the tilt.
    assert np.abs(back.poses[:, 3:] - block.poses[:, 3:]).max() < 1e-6


def test_a_system_in_feet_is_no_system_of_a_block():
    with pytest.raises(InputError, match="foot"):
        complete(placed(), Additions(crs="EPSG:2225"))


def test_a_table_that_excel_saved_in_its_code_page(tmp_path):
    """The line that is named stands far behind where the file was read in one piece."""
    path = tmp_path / "control.txt"
    rows = [f"P{k},{k}.5,2,3" for k in range(3000)]
    path.write_bytes("\n".join(["name,x,y,z", *rows, "Mühle,7,8,9"]).encode("cp1252"))
    with pytest.warns(RuntimeWarning, match=r"line 3002: .* \('Mühle'\)"):
        points = read_text(path).table
    assert points["point"].iloc[-1] == "Mühle"
    path.write_bytes("\n".join(["name,x,y,z", *rows, "Точка,7,8,9"]).encode("cp1251"))
    with pytest.raises(InputError, match="line 3002: the text is not UTF-8"):
        read_text(path)
