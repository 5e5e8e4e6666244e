"""Every fault of a track gives one sentence with the file, the row and what to do."""

import re
from pathlib import Path

import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import check_quality, read_track

DATA = Path(__file__).parent / "data"
REMEDIES = "add|correct|delete|export|fill|give|install|name|process|save|sort|take|use|write"


def fault(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    sentence = str(caught.value)
    assert "\n" not in sentence and ". " not in sentence
    assert re.match(REMEDIES, re.split(r"[;:] ", sentence)[-1]), sentence
    return sentence


def swapped(text):
    lines = text.splitlines()
    lines[-1], lines[-2] = lines[-2], lines[-1]
    return "\n".join(lines)


def reverse(text):
    lines = text.splitlines()
    head = [k for k, line in enumerate(lines) if line.startswith(("%", "time_s"))][-1] + 1
    return "\n".join(lines[:head] + lines[: head - 1 : -1])


# file, what is done to it, what the sentence must contain
SPOILT = {
    "time backwards": (
        "llh.pos", swapped, ["llh.pos, row 15", "goes back by 0.2 s", "row 14", "sort"],
    ),
    "all rows from last to first": (
        "llh.pos", reverse, ["llh.pos, row 9", "goes back by 0.2 s"],
    ),
    "time backwards in a block": (
        "track.csv", swapped, ["track.csv, row 7", "goes back by 0.5 s"],
    ),
    "one epoch, two positions": (
        "llh.pos",
        lambda text: text.replace("08:20:00.200", "08:20:00.000"),
        ["llh.pos, row 9", "stands in row 8 too", "another position"],
    ),
    "header missing": (
        "llh.pos",
        lambda text: "\n".join(text.splitlines()[7:]),
        ["llh.pos, row 1", "header is missing", "time system"],
    ),
    "header missing in a block": (
        "track.csv",
        lambda text: "\n".join(text.splitlines()[1:]),
        ["track.csv", "header is missing"],
    ),
    "units missing in GrafNav": (
        "grafnav_ecef_week.txt",
        lambda text: text.replace(" (weeks)     (sec)         (m)             (m)      ", "none"),
        ["grafnav_ecef_week.txt", "no header with names and units"],
    ),
    "decimal commas": (
        "llh.pos",
        lambda text: "\n".join(
            x if x.startswith("%") else x.replace(".", ",") for x in text.splitlines()
        ),
        ["llh.pos, row 8", "decimal comma"],
    ),
    "a word for a number": (
        "llh.pos",
        lambda text: text.replace("-100.250370000", "error"),
        ["llh.pos, row 9", "longitude = 'error'"],
    ),
    "nan for a position": (
        "xyz_tow.pos",
        lambda text: text.replace("4552326.0475", "nan"),
        ["xyz_tow.pos, row 9", "z-ecef = 'nan'"],
    ),
    "no such latitude": (
        "llh.pos",
        lambda text: text.replace("45.830120300", "145.83012030"),
        ["llh.pos, row 9", "not a place on Earth"],
    ),
    "no such day": (
        "llh.pos",
        lambda text: text.replace("2024/06/24 08:20:00.200", "2024/06/31 08:20:00.200"),
        ["llh.pos, row 9", "is not a time"],
    ),
    "cut off": (
        "llh.pos", lambda text: text[:-12],
        ["llh.pos, row 15", "23 fields where the header has 24"],
    ),
    "no epochs": (
        "llh.pos", lambda text: "\n".join(text.splitlines()[:7]), ["llh.pos holds no positions"],
    ),
    "empty": ("llh.pos", lambda text: "", ["llh.pos is empty"]),
    "something else": (
        "llh.pos", lambda text: "Dear Ada,\nplease find", ["in no format that is known", "RTKLIB"],
    ),
    "empty cell": (
        "track.csv", lambda text: text.replace("100.5,5,2", "100.5,,2"),
        ["track.csv, row 3", "x is empty"],
    ),
    "column missing": (
        "track.csv", lambda text: text.replace("time_s,x,y,z", "time_s,x,y,h"),
        ["track.csv, row 1", "column z is missing"],
    ),
    "semicolons in rows only": (
        "llh.pos", lambda text: "\n".join(
            line if line.startswith("%") else ";".join(line.split()) for line in text.splitlines()
        ),
        ["llh.pos, row 8", "';' stands between the fields"],
    ),
    "no such time system": (
        "llh.pos", lambda text: text.replace("%  GPST ", "%  MEZ  "),
        ["llh.pos, row 7", "'MEZ' is not known"],
    ),
    "GrafNav row cut off": (
        "grafnav_midnight.txt", lambda text: text[:-60], ["row 17", "fields where the header has"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SPOILT)
def test_a_spoilt_track_is_refused_in_one_sentence(case, tmp_path):
    name, spoil, wanted = SPOILT[case]
    before = (DATA / name).read_bytes().decode()
    after = spoil(before.replace("\r\n", "\n"))
    assert after != before
    (tmp_path / name).write_text(after)
    sentence = fault(read_track, tmp_path / name)
    for part in wanted:
        assert part in sentence, sentence


def test_a_missing_file_is_named(tmp_path):
    assert f"{tmp_path / 'none.pos'} does not exist" in fault(read_track, tmp_path / "none.pos")


def test_image_times_are_not_a_track():
    assert "holds image times, not a track" in fault(read_track, DATA / "week_end.MRK")


def test_epochs_that_are_written_twice_are_left_out_and_counted(tmp_path):
    lines = (DATA / "llh.pos").read_text().splitlines()
    (tmp_path / "x.pos").write_text("\n".join(lines[:9] + lines[8:] + lines[-1:]))
    track = read_track(tmp_path / "x.pos")
    assert track.table.equals(read_track(DATA / "llh.pos").table)
    assert "2 epochs written twice (first in row 10)" in track.notes[0]


def test_a_track_of_single_positions_is_read_and_refused_for_use(tmp_path):
    text = (DATA / "llh.pos").read_text()
    text = text.replace("   1  15", "   5  15").replace("   2  15", "   5  15")
    (tmp_path / "x.pos").write_text(text)
    track = read_track(tmp_path / "x.pos")
    assert "single positions" in track.notes[0]
    assert "all 8 epochs are single positions" in fault(check_quality, track)
    check_quality(read_track(DATA / "llh.pos"))


def test_flights_may_follow_each_other_in_any_order(tmp_path):
    rows = (DATA / "track.csv").read_text().splitlines()
    second = [row.replace("10", "9", 1).replace(",A,", ",B,") for row in rows[1:]]
    (tmp_path / "track.csv").write_text("\n".join(rows + second))
    assert len(read_track(tmp_path / "track.csv").table) == 12


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        ("rover.ubx", b"\xb5b\x01\x07" + bytes(range(200)), "u-blox UBX"),
        ("DJI_PPKRAW.bin", b"\xd3\x00\x13" + bytes(range(200)), "RTCM"),
        ("rover.sbf", b"$@\x12\x34" + bytes(range(200)), "Septentrio SBF"),
        ("rover.crx", b"3.0     COMPACT RINEX FORMAT     CRINEX VERS / TYPE\n", "RINEX, packed"),
        ("sbet.txt", b"POSPac MMS 8.4 Export\n\nTIME, EASTING\n 100.0 1\n", "track.csv of a block"),
    ],
)
def test_raw_data_are_named_for_what_they_are(tmp_path, name, content, named):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name} .*{named}"):
        read_track(tmp_path / name)


def test_solutions_of_two_time_systems_in_one_file_are_refused(tmp_path):
    columns = "latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m)"
    row = "2024/06/24 08:{:02d}:00.000 47.5 8.7 500.0 1 12 0.01 0.01 0.02"
    rows = [f"%  {system}  {columns}\n{row.format(k)}\n" for k, system in ((1, "GPST"), (9, "UTC"))]
    path = tmp_path / "both.pos"
    path.write_text("".join(rows))
    with pytest.raises(InputError, match="several solutions with different headers"):
        read_track(path)
    path.write_text(rows[0] + rows[1].replace("UTC", "GPST"))
    assert len(read_track(path).table) == 2
