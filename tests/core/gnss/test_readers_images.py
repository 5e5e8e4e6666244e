"""Image times and positions: DJI, MicMac, Modified Julian Days, EXIF, a block."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from corridor.core.errors import InputError
from corridor.core.gnss import read_exposures, read_track
from corridor.core.gnss.reading import _formats as formats
from corridor.core.textfile import read_lines

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("file", sorted(DATA.iterdir()), ids=lambda file: file.name)
def test_one_format_and_only_one_recognises_a_file(file):
    head = "\n".join(read_lines(file)[:80])
    assert [module.recognise(head) for module in formats()].count(True) == 1


class TestTimeMarksOfDji:
    marks = read_exposures(DATA / "week_end.MRK")

    def test_times_rise_across_the_end_of_the_week(self):
        assert (self.marks.day, self.marks.time_system) == ("2024-06-29", "GPST")
        assert self.marks.table["time_s"].tolist() == [86398.25, 86399.75, 86401.25, 86402.75]

    def test_a_week_that_does_not_change_with_its_seconds_is_counted_on(self, tmp_path):
        text = (DATA / "week_end.MRK").read_text()
        assert "[2321]" in text
        (tmp_path / "x.MRK").write_text(text.replace("[2321]", "[2320]"))
        stays = read_exposures(tmp_path / "x.MRK")
        assert stays.table["time_s"].tolist() == self.marks.table["time_s"].tolist()
        assert any("was counted on" in note for note in stays.notes)

    def test_v_is_down_and_north_is_written_first(self):
        """The file prints -180 N, 574 E, 233 V."""
        offset = self.marks.table[["offset_e", "offset_n", "offset_u"]].iloc[0]
        assert offset.tolist() == pytest.approx([0.574, -0.180, -0.233])

    def test_standard_deviations_are_written_north_first(self):
        assert self.marks.table[["sx", "sy", "sz"]].iloc[0].tolist() == [0.0095, 0.0102, 0.0236]

    def test_a_mark_of_flag_0_has_a_time_but_no_position(self):
        assert self.marks.table["flag"].tolist() == [50, 34, 16, 0]
        assert self.marks.table["x"].isna().tolist() == [False, False, False, True]
        for said in (
            "1 of 4 marks is not an RTK fix: flag 34, a float",
            "flag 16, a single position",
        ):
            assert any(said in note for note in self.marks.notes)

    def test_numbers_find_their_images(self):
        names = [f"DJI_20240629235958_000{k}_V.JPG" for k in (4, 3, 2, 1)]
        assert self.marks.named(names).table["image"].tolist() == names[::-1]
        assert self.marks.named(names[:3]).table["image"].tolist() == names[2::-1]
        with pytest.raises(InputError, match="no image has number 1"):
            self.marks.named(names[:1])

    def test_a_row_that_is_no_time_mark_is_named(self, tmp_path):
        text = (DATA / "week_end.MRK").read_text().replace("[2320]\t  -180,N", "[2320]\t,N", 1)
        (tmp_path / "x.MRK").write_text(text)
        with pytest.raises(InputError, match=r"x.MRK, row 1: .* is not a time mark"):
            read_exposures(tmp_path / "x.MRK")


class TestMicmac:
    def test_a_track_in_xml_is_geocentric_in_gps_time(self):
        track = read_track(DATA / "micmac_track.xml")
        same = read_track(DATA / "xyz_tow.pos")
        assert (track.day, track.time_system, track.crs) == ("2024-06-24", "GPST", "EPSG:4978")
        assert np.array_equal(track.positions(), same.positions())
        assert track.table["time_s"].to_numpy() == pytest.approx(
            same.table["time_s"].to_numpy(), abs=1e-6
        )
        assert track.table["quality"].tolist() == same.table["quality"].tolist()

    def test_an_epoch_at_0_0_0_is_no_position(self):
        track = read_track(DATA / "micmac_track.xml")
        assert len(track.table) == 8 and "1 epoch at 0 0 0" in track.notes[0]

    def test_image_times_in_xml(self):
        times = read_exposures(DATA / "micmac_times.xml")
        assert times.table["image"].tolist() == ["img_1.tif", "img_2.tif", "img_3.tif"]
        assert times.table["time_s"].tolist() == pytest.approx([30000.3, 30000.7, 30001.1])
        assert times.notes == ()

    def test_positions_in_text_of_which_0_0_0_with_sigma_minus_1_is_none(self):
        table = read_exposures(DATA / "micmac_positions.txt").table
        assert table[["x", "y", "z"]].iloc[0].tolist() == [100.25, 200.5, 60.125]
        assert table[["sx", "sy", "sz"]].iloc[2].tolist() == [0.011, 0.013, 0.021]
        assert table[["x", "sx"]].isna().iloc[1].all() and table["time_s"].isna().all()

    def test_week_and_seconds_in_text(self):
        times = read_exposures(DATA / "micmac_week.txt")
        assert (times.day, times.time_system) == ("2024-06-29", "GPST")
        assert times.table["time_s"].tolist() == [86399.5, 86401.25]

    def test_xml_that_ends_early_is_refused(self, tmp_path):
        text = (DATA / "micmac_track.xml").read_text()
        (tmp_path / "x.xml").write_text(text[: len(text) // 2])
        with pytest.raises(InputError, match=r"x.xml, line \d+: the XML is broken or ends early"):
            read_track(tmp_path / "x.xml")


class TestModifiedJulianDays:
    def test_six_decimals_are_43_ms_and_it_says_so(self):
        times = read_exposures(DATA / "mjd_times.txt")
        assert times.time_system == "GPST"  # its comment says so
        error = times.table["time_s"].to_numpy() - [30000.3, 30000.7, 30001.1]
        assert np.abs(error).max() < 0.0433
        assert times.resolution_s == pytest.approx(0.0864)
        assert "off by up to 43 ms" in times.notes[0]

    def test_a_track_names_no_time_system(self):
        track = read_track(DATA / "mjd_track.txt")
        assert (track.time_system, track.day, track.crs) == (None, "2024-06-24", "EPSG:4978")

    def test_epochs_closer_than_the_decimals_are_refused(self, tmp_path):
        lines = (DATA / "mjd_track.txt").read_text().splitlines()
        lines[1] = lines[1].replace("60485.347234", "60485.347222")
        (tmp_path / "x.txt").write_text("\n".join(lines))
        with pytest.raises(InputError, match=r"x.txt, row 2: two epochs .* steps of 86 ms"):
            read_track(tmp_path / "x.txt")


def photograph(file, time="2024:06:24 10:20:31", decimals=None, zone=None, place=None):
    tags = Image.Exif()
    if place:
        lon, lat = place
        gps = {1: "NS"[lat < 0], 2: (abs(lat), 0.0, 0.0), 3: "EW"[lon < 0], 4: (abs(lon), 0.0, 0.0)}
        tags.get_ifd(0x8825).update(gps)
    own = tags.get_ifd(0x8769)
    for tag, value in ((36867, time), (37521, decimals), (36881, zone)):
        if value is not None:
            own[tag] = value
    Image.new("L", (8, 8)).save(file, exif=tags)


class TestExif:
    def test_positions_come_with_the_times_as_witnesses_of_the_clock(self, tmp_path):
        photograph(tmp_path / "a.jpg", place=(172.5, -43.25))
        photograph(tmp_path / "b.jpg")
        found = read_exposures(tmp_path)
        assert found.crs == "EPSG:4979"
        assert found.table[["x", "y"]].iloc[0].tolist() == [172.5, -43.25]
        assert found.table[["x", "y"]].iloc[1].isna().all()
        photograph(tmp_path / "a.jpg")
        assert read_exposures(tmp_path).crs is None

    @pytest.mark.parametrize(
        ("decimals", "seconds"), [("5", 0.5), ("05", 0.05), ("050", 0.05), ("123456", 0.123456)]
    )
    def test_sub_seconds_are_a_string_of_decimals(self, tmp_path, decimals, seconds):
        photograph(tmp_path / "a.jpg", decimals=decimals)
        times = read_exposures(tmp_path)
        assert times.table["time_s"].iloc[0] == pytest.approx(37231 + seconds, abs=1e-9)
        assert times.time_system is None

    def test_the_zone_is_the_time_system(self, tmp_path):
        photograph(tmp_path / "a.jpg", decimals="250", zone="+07:00")
        assert read_exposures(tmp_path).time_system == "UTC+07:00"

    def test_whole_seconds_are_said_to_be_too_coarse(self, tmp_path):
        photograph(tmp_path / "a.jpg")
        times = read_exposures(tmp_path)
        assert times.resolution_s == 1.0 and "too coarse" in times.notes[-1]

    def test_images_are_in_order_of_their_names_and_may_pass_midnight(self, tmp_path):
        photograph(tmp_path / "b.jpg", "2024:06:25 00:00:01", "500")
        photograph(tmp_path / "a.jpg", "2024:06:24 23:59:59", "500")
        times = read_exposures(tmp_path)
        assert times.day == "2024-06-24"
        assert times.table["time_s"].tolist() == [86399.5, 86401.5]

    def test_a_photograph_without_time_is_named(self, tmp_path):
        photograph(tmp_path / "a.jpg", time=None)
        with pytest.raises(InputError, match=r"a.jpg has no time of exposure"):
            read_exposures(tmp_path)

    def test_two_zones_are_refused(self, tmp_path):
        photograph(tmp_path / "a.jpg", zone="+07:00")
        photograph(tmp_path / "b.jpg", zone="+08:00")
        with pytest.raises(InputError, match=r"b.jpg: its clock shows UTC\+08:00"):
            read_exposures(tmp_path)


class TestBlock:
    def test_names_stay_text_and_an_image_without_time_is_kept(self):
        times = read_exposures(DATA / "images.csv")
        assert times.table["image"].tolist() == ["007", "i2", "i3"]
        assert times.table["time_s"].isna().tolist() == [False, True, False]
        assert "1 of 3 images have no time_s (first in row 3)" in times.notes[0]

    def test_a_folder_stands_for_its_tables(self):
        assert len(read_exposures(DATA).table) == 3
        assert read_track(DATA).source.name == "track.csv"

    def test_parquet_holds_the_same(self, tmp_path):
        import pandas as pd

        pd.read_csv(DATA / "track.csv").to_parquet(tmp_path / "track.parquet")
        track = read_track(tmp_path / "track.parquet")
        assert track.table.equals(read_track(DATA / "track.csv").table)


def test_two_images_of_one_name_are_refused(tmp_path):
    file = tmp_path / "images.csv"
    file.write_text("image,time_s\na.jpg,1\nb.jpg,2\na.jpg,3\n")
    with pytest.raises(InputError, match="row 4: image a.jpg occurs twice"):
        read_exposures(file)
