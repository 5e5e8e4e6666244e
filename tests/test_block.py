import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.csv
import pytest
from block_folder import FILES, TOML, block_folder, small

import corridor.core.block.writing
from corridor.core.block import Block, read
from corridor.core.errors import InputError
from corridor.core.output import whole_folder

TABLES = ("images", "tie_points", "points", "marks", "ground", "gnss", "rates", "track")
REAL = ("strasbourg", "roma", "saraburi/block")


@pytest.fixture
def folder(tmp_path):
    return block_folder(tmp_path)


def assert_identical(a: Block, b: Block):
    for table in TABLES:
        pd.testing.assert_frame_equal(
            getattr(a, table), getattr(b, table), check_exact=True, obj=table
        )
    for key in ("name", "crs", "description", "source", "licence", "extra"):
        assert getattr(a, key) == getattr(b, key)
    assert a.lever_arm == b.lever_arm and a.lever_arm_fixed == b.lever_arm_fixed
    assert np.array_equal(a.offset, b.offset)
    assert {key: np.array(value).tolist() for key, value in a.sigma.items()} == {
        key: np.array(value).tolist() for key, value in b.sigma.items()
    }
    assert [c.to_table() for c in a.cameras.values()] == [c.to_table() for c in b.cameras.values()]
    assert list(a.cameras) == list(b.cameras)


def content(folder):
    return {
        path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


class TestReading:
    def test_names_that_look_like_numbers_stay_apart(self, folder):
        block = read(folder)
        assert block.images["image"].tolist() == ["007", "i2", "i3"]
        assert block.tie_points["point"].cat.categories.tolist() == ["1", "01", "once"]
        assert block.images["strip"].tolist() == ["1", "1", "2"]

    def test_codes_of_images_are_rows_of_the_image_table(self, folder):
        block = read(folder)
        for table in ("tie_points", "marks"):
            frame = getattr(block, table)
            rows = frame["image"].cat.codes
            assert block.images["image"].to_numpy()[rows].tolist() == frame["image"].tolist()
            assert np.array_equal(block.image_rows(table), rows)
        assert block.image_rows("gnss").tolist() == [0, 1]

    def test_numbers_are_float64_and_names_are_text(self, folder):
        block = read(folder)
        assert block.images["time_s"].dtype == np.float64
        assert block.images["flight"].dtype == "str"
        assert block.track["quality"].dtype == np.float64

    def test_settings_come_from_block_toml_and_the_rest_is_defaults(self, folder):
        block = read(folder)
        assert block.sigma["tie_px"] == 0.7
        assert block.sigma["mark_px"] == 0.5  # the default
        assert block.sigma["gnss_m"].tolist() == [0.03, 0.03, 0.03]
        assert block.lever_arm == {"default": (0.1, 0.2, -0.3), "B": (0.0, 0.0, 0.5)}
        assert block.lever_arm_fixed
        assert block.extra == {"processed_by": ["us", "them"], "pilot": {"name": "Ada"}}
        assert block.cameras["old camera"].calibrated
        assert block.cameras["P1"].extra == {"serial": "0017"}
        assert block.offset.tolist() == [717541.0, 1606017.0, 0.1]

    def test_sigmas_given_replace_the_defaults_row_by_row(self, folder):
        block = read(folder)
        assert block.tie_sigma().tolist() == [0.7, 0.4, 0.7, 0.7, 0.7, 0.7]
        assert block.mark_sigma().tolist() == [0.5, 0.5]
        assert block.gnss_sigma().tolist() == [[0.02, 0.03, 0.03], [0.03, 0.03, 0.03]]
        assert block.ground_sigma()[0].tolist() == [0.01, 0.01, 0.01]

    def test_a_missing_file_is_an_empty_table(self, folder):
        (folder / "rates.csv").unlink()
        block = read(folder)
        assert len(block.rates) == 0
        assert block.rates.columns.tolist() == ["time_s", "wx", "wy", "wz"]
        assert not block.has("rates") and not block.has("rates.wx")

    @pytest.mark.parametrize("ending", ["\r\n", "\n"])
    @pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""], ids=["mark", "no mark"])
    def test_byte_order_mark_and_line_ends_of_windows_change_nothing(self, folder, mark, ending):
        plain = read(folder)
        for name, text in FILES.items():
            (folder / name).write_bytes(mark + text.replace("\n", ending).encode())
        assert_identical(plain, read(folder))

    def test_blanks_around_numbers_and_in_the_header_do_not_matter(self, folder):
        plain = read(folder)
        text = FILES["marks.csv"].replace(",x,y", ", x, y").replace(",100,", ", +100 ,")
        (folder / "marks.csv").write_text(text)
        assert_identical(plain, read(folder))

    def test_line_breaks_and_commas_inside_quotes_belong_to_the_text(self, folder):
        text = FILES["images.csv"].replace("cloudy", '"first\nsecond, ""third"""')
        (folder / "images.csv").write_text(text)
        block = read(folder)
        assert block.images["note"].iloc[0] == 'first\nsecond, "third"'
        assert block.where("images", 1) == "images.csv, row 4"

    def test_a_spreadsheet_s_empty_last_columns_are_ignored(self, folder):
        plain = read(folder)
        (folder / "marks.csv").write_text(FILES["marks.csv"].replace("\n", ",,\n"))
        assert_identical(plain, read(folder))

    def test_a_table_may_be_parquet(self, folder):
        plain = read(folder)
        marks = pd.DataFrame(
            {"point": ["G1", "G1"], "image": ["007", "i2"], "x": [100, 300], "y": [200, 200]}
        )
        marks.to_parquet(folder / "marks.parquet")
        (folder / "marks.csv").unlink()
        assert_identical(plain, read(folder))

    def test_points_numbered_in_a_parquet_file_become_text(self, folder):
        pd.DataFrame({"point": [1], "x": [0], "y": [0.5], "z": [np.nan]}).assign(
            y=np.nan, x=np.nan
        ).to_parquet(folder / "points.parquet")
        (folder / "points.csv").unlink()
        assert read(folder).points["point"].tolist() == ["1"]

    def test_nearly_unit_quaternions_are_made_unit(self, folder):
        text = FILES["images.csv"].replace("100,0,1,0,0", "100,0.7071,0.7071,0,0")
        (folder / "images.csv").write_text(text)
        quaternion = read(folder).images[["qw", "qx", "qy", "qz"]].to_numpy()[:2]
        assert np.abs(np.linalg.norm(quaternion, axis=1) - 1).max() < 1e-15
        # 0.7071 and 0.7071 stand for equal parts.
        assert np.abs(quaternion[0] - [np.sqrt(0.5), np.sqrt(0.5), 0, 0]).max() < 1e-15

    def test_row_order_is_that_of_the_file(self, folder):
        block = read(folder)
        assert block.tie_points["point"].tolist() == ["1", "01", "1", "01", "1", "once"]


class TestLookingUp:
    def test_images_without_a_flight_belong_to_flight_1(self, folder):
        (folder / "images.csv").write_text(FILES["images.csv"].replace("007,P1,A", "007,P1,"))
        block = read(folder)
        assert block.flight_names == ["1", "A", "B"]
        assert block.image_flight.tolist() == [0, 1, 2]

    def test_a_block_without_flights_is_one_flight(self):
        block = small()
        assert block.flight_names == ["1"] and block.image_flight.tolist() == [0, 0]

    def test_has_wants_at_least_one_known_value(self, folder):
        block = read(folder)
        assert block.has("images.time_s")  # two of three
        assert not block.has("images.temperature_c")
        assert block.has("gnss") and block.has("gnss.x") and block.has("camera.readout_s")
        assert not block.select(images=["i3"]).has("camera.readout_s")
        assert not block.select(images=["i3"]).has("images.time_s")

    def test_an_unknown_value_and_an_absent_column_are_nan(self, folder):
        block = read(folder)
        assert block.column("images", "time_s").tolist()[:2] == [10.5, 12.5]
        assert np.isnan(block.column("images", "time_s")[2])
        assert np.isnan(block.column("images", "wx")).all()

    def test_an_unlisted_column_gives_numbers_where_it_holds_numbers(self, folder):
        text = FILES["marks.csv"].replace("y\n", "y,quality\n").replace("200\n", "200,7\n")
        (folder / "marks.csv").write_text(text)
        block = read(folder)
        assert block.marks["quality"].tolist() == ["7", "7"]
        assert block.column("marks", "quality").tolist() == [7.0, 7.0]
        with pytest.raises(InputError, match=r"images\.csv, row 2: note = 'cloudy'"):
            block.column("images", "note")

    def test_where_counts_lines_of_the_file_and_blank_ones_too(self, folder):
        assert read(folder).where("marks", 1) == "marks.csv, row 3"
        (folder / "marks.csv").write_text(FILES["marks.csv"].replace("\n", "\n\n"))
        assert read(folder).where("marks", 1) == "marks.csv, row 5"

    def test_a_copy_shares_nothing(self, folder):
        block = read(folder)
        other = block.copy()
        other.points.loc[0, "x"] = 99.0
        other.cameras["P1"].interior[0] = 1.0
        other.lever_arm["B"] = (9.0, 9.0, 9.0)
        other.offset[0] = 0.0
        other.sigma["gnss_m"][0] = 7.0
        other.extra["pilot"]["name"] = "Bob"
        assert_identical(block, read(folder))

    def test_what_is_changed_in_a_block_is_not_changed_in_its_copy(self, folder):
        block = read(folder)
        other = block.copy()
        block.points.loc[0, "x"] = 99.0
        block.tie_points["x"] += 1.0
        block.images.iloc[0, 0] = "other"
        assert_identical(other, read(folder))


class TestWriting:
    def test_reading_what_was_written_gives_the_same_block(self, folder, tmp_path):
        block = read(folder)
        block.write(tmp_path / "copy")
        assert_identical(block, read(tmp_path / "copy"))

    def test_parquet_gives_the_same_block(self, folder, tmp_path):
        block = read(folder)
        block.write(tmp_path / "copy", form="parquet")
        assert (tmp_path / "copy" / "tie_points.parquet").is_file()
        assert not list((tmp_path / "copy").glob("*.csv"))
        assert_identical(block, read(tmp_path / "copy"))

    def test_parquet_in_many_groups_gives_the_same_block(self, folder, tmp_path, monkeypatch):
        """Each group has the names that it needs, in its own order; marks are in no order."""
        monkeypatch.setattr(corridor.block.writing, "_GROUP", 2)
        block = read(folder)
        block.marks = block.marks.iloc[::-1].reset_index(drop=True)
        block = block.copy()  # brings its names into the order of their rows
        block.write(tmp_path / "copy", form="parquet")
        assert_identical(block, read(tmp_path / "copy"))

    def test_how_the_observations_were_stored_is_known(self, folder, tmp_path):
        assert small().form == read(folder).form == "csv"
        read(folder).write(tmp_path / "copy", form="parquet")
        assert read(tmp_path / "copy").form == read(tmp_path / "copy").copy().form == "parquet"

    def test_a_block_made_in_memory_comes_back_the_same(self, tmp_path):
        block = small()
        assert block.tie_points["point"].tolist() == ["7", "7", "8"]
        block.write(tmp_path / "new" / "folder")
        assert_identical(block, read(tmp_path / "new" / "folder"))

    @pytest.mark.parametrize("form", ["csv", "parquet"])
    def test_every_digit_of_a_number_comes_back(self, tmp_path, form):
        noise = np.random.default_rng(5)
        bits = noise.integers(0, 2**63, 4000, dtype=np.int64).view(np.float64)
        values = np.concatenate([bits[np.isfinite(bits)], [0.1, -0.0, 5e-324, 1.79e308]])
        points = pd.DataFrame(
            {"point": np.arange(len(values)).astype(str), "x": values, "y": -values, "z": 1 / 3}
        )
        small(points=points).write(tmp_path / "b", form=form)
        again = read(tmp_path / "b").points
        assert again["x"].to_numpy().tobytes() == values.tobytes()
        assert again["y"].to_numpy().tobytes() == (-values).tobytes()

    def test_settings_come_back_to_the_last_bit(self, tmp_path):
        block = small()
        block.cameras["c"] = block.cameras["c"].with_values(f=1 / 3, k1=1e-17)
        block.offset = np.array([1e22, -1e-7, 2 / 3])
        block.description = 'a "quote", a \\ and a\nnew line, é \x7f\x01'
        block.extra = {"list": [{"a": 1}, {"b": [1.5, True]}], "t": {"u": {"v w": 1}, "e": {}}}
        block.write(tmp_path / "b")
        assert_identical(block, read(tmp_path / "b"))

    @pytest.mark.parametrize("name", REAL)
    def test_real_blocks_come_back_the_same(self, real_data, tmp_path, name):
        block = read(real_data / name)
        block.write(tmp_path / "copy")
        assert_identical(block, read(tmp_path / "copy"))

    def test_a_block_is_replaced_and_strangers_in_its_folder_stay(self, folder):
        (folder / "README.md").write_text("mine")
        (folder / "pictures").mkdir()
        (folder / "pictures" / "a.jpg").write_bytes(b"\xff\xd8")
        smaller = read(folder).select(images=["007"])
        smaller.write(folder)
        assert_identical(smaller, read(folder))
        assert (folder / "README.md").read_text() == "mine"
        assert (folder / "pictures" / "a.jpg").read_bytes() == b"\xff\xd8"
        assert [path.name for path in folder.parent.iterdir()] == ["two_strips"]

    def test_a_csv_does_not_stay_beside_the_parquet_that_replaces_it(self, folder):
        block = read(folder)
        block.write(folder, form="parquet")
        assert_identical(block, read(folder))

    def test_another_folder_is_not_replaced(self, folder, tmp_path):
        other = tmp_path / "photographs"
        other.mkdir()
        (other / "a.jpg").write_bytes(b"1")
        with pytest.raises(InputError, match="photographs is a folder without block.toml"):
            read(folder).write(other)
        with pytest.raises(InputError, match="a.jpg is a file"):
            read(folder).write(other / "a.jpg")
        assert content(tmp_path / "photographs") == {(other / "a.jpg").relative_to(other): b"1"}

    def test_an_empty_folder_is_filled(self, folder, tmp_path):
        (tmp_path / "empty").mkdir()
        read(folder).write(tmp_path / "empty")
        assert (tmp_path / "empty" / "block.toml").is_file()

    def test_a_block_with_a_fault_is_not_written(self, tmp_path):
        block = small()
        block.images.loc[0, "camera"] = "gone"
        with pytest.raises(InputError, match="camera 'gone'"):
            block.write(tmp_path / "b")
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        "stop",
        [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()],
        ids=["disk full", "Ctrl-C"],
    )
    @pytest.mark.parametrize("at", [1, 3, 8])
    def test_an_interrupted_write_leaves_the_old_block_and_nothing_else(
        self, folder, monkeypatch, stop, at
    ):
        before = content(folder)
        block = read(folder)
        block.points["x"] += 1.0
        calls = []
        real = pyarrow.csv.write_csv

        def write(arrow, file, options):
            real(arrow, file, options)
            calls.append(arrow)
            if len(calls) == at:
                raise stop

        monkeypatch.setattr(pyarrow.csv, "write_csv", write)
        for target in (folder, folder.parent / "new" / "block"):
            calls.clear()
            with pytest.raises(type(stop)):
                block.write(target)
        assert content(folder) == before
        assert [path.name for path in folder.parent.iterdir()] == ["two_strips"]

    @pytest.mark.parametrize("at", [1, 2])
    @pytest.mark.parametrize("after", [False, True], ids=["before it", "after it"])
    def test_an_interrupted_rename_leaves_one_whole_block(self, folder, monkeypatch, at, after):
        old, new = read(folder), read(folder)
        new.points["x"] += 1.0
        calls = []
        real = os.rename

        def rename(self, target):
            calls.append(target)
            stop = len(calls) == at
            if not stop or after:
                real(self, target)
            if stop:
                raise KeyboardInterrupt

        monkeypatch.setattr(corridor.block.writing.Path, "rename", rename)
        with pytest.raises(KeyboardInterrupt):
            new.write(folder)
        assert_identical(new if (at, after) == (2, True) else old, read(folder))
        assert [path.name for path in folder.parent.iterdir()] == ["two_strips"]

    def test_a_whole_folder_is_for_other_rooms_too(self, tmp_path):
        with whole_folder(tmp_path / "out", mark="result.json") as part:
            (part / "result.json").write_text("{}")
            assert not (tmp_path / "out").exists()
        with (
            pytest.raises(ZeroDivisionError),
            whole_folder(tmp_path / "out", "result.json") as part,
        ):
            (part / "result.json").write_text("half")
            raise ZeroDivisionError
        assert (tmp_path / "out" / "result.json").read_text() == "{}"
        assert len(list(tmp_path.iterdir())) == 1


class TestSelecting:
    def test_everything_is_the_same_block(self, folder):
        block = read(folder)
        assert_identical(block, block.select())
        assert_identical(block, block.select(images=["i3", "007", "i2"]))

    def test_images_take_their_observations_points_and_gnss_along(self, folder):
        part = read(folder).select(images=["i2"])
        assert part.images["image"].tolist() == ["i2"]
        assert part.tie_points["point"].tolist() == ["1", "01"]
        assert part.tie_points["image"].cat.categories.tolist() == ["i2"]
        assert part.points["point"].tolist() == ["1", "01"]  # 'once' lost its only image
        assert part.marks["image"].tolist() == ["i2"]
        assert part.ground["point"].tolist() == ["G1", "G2"]  # G2 had none to lose
        assert part.gnss["image"].tolist() == ["i2"]
        assert list(part.cameras) == ["P1"]
        assert list(part.lever_arm) == ["default"]
        assert part.track["flight"].tolist() == ["A", "A"]
        assert part.rates["flight"].tolist() == ["A", "A"]
        part.check()

    def test_flights_choose_their_images(self, folder):
        part = read(folder).select(flights=["A"])
        assert part.images["image"].tolist() == ["007", "i2"]
        assert read(folder).select(flights="B").images["image"].tolist() == ["i3"]

    def test_what_is_given_restricts_together(self, folder):
        part = read(folder).select(images=["007", "i3"], flights=["A"], points=["1", "G1"])
        assert part.images["image"].tolist() == ["007"]
        assert part.tie_points["point"].tolist() == ["1"]
        assert part.tie_points["point"].cat.categories.tolist() == ["1"]
        assert part.points["point"].tolist() == ["1"]
        assert part.ground["point"].tolist() == ["G1"]

    def test_a_selection_written_and_read_is_the_same(self, folder, tmp_path):
        # After the cut '01' is seen before '1': the order of categories must follow.
        part = read(folder).select(images=["i2", "007"])
        part = part.select(points=["01", "1", "G1"])
        part.write(tmp_path / "part")
        assert_identical(part, read(tmp_path / "part"))

    def test_categories_follow_the_rows_that_are_left(self):
        part = small(
            tie_points=pd.DataFrame(
                {"point": list("pqqp"), "image": list("aabb"), "x": 1.0, "y": [1.0, 2.0, 3.0, 4.0]}
            )
        ).select(images=["b"])
        assert part.tie_points["point"].cat.categories.tolist() == ["q", "p"]
        assert part.tie_points.index.tolist() == [0, 1]

    def test_the_block_it_came_from_is_not_touched(self, folder):
        block = read(folder)
        part = block.select(images=["i2"])
        part.points.loc[0, "x"] = 99.0
        part.cameras["P1"].interior[0] = 1.0
        assert_identical(block, read(folder))

    def test_an_unknown_name_is_named(self, folder):
        block = read(folder)
        with pytest.raises(InputError, match="no image 'i9'"):
            block.select(images=["i2", "i9"])
        with pytest.raises(InputError, match="no flight 'C'"):
            block.select(flights=["C"])
        with pytest.raises(InputError, match="no point 'G9'"):
            block.select(points=["G9"])

    def test_nothing_left_is_an_error(self, folder):
        with pytest.raises(InputError, match="leaves no observation"):
            read(folder).select(points=["G2"])

    @pytest.mark.parametrize("name", REAL)
    def test_half_of_a_real_block_holds_together(self, real_data, name):
        block = read(real_data / name)
        half = block.select(images=block.images["image"][::2])
        half.check()
        assert set(half.tie_points["image"]) <= set(block.images["image"][::2])
        assert set(half.points["point"]) == set(half.tie_points["point"])


class TestSummary:
    def test_counts_of_a_small_block_by_hand(self, folder):
        summary = read(folder).summary()
        assert summary.counts["images"] == 3
        assert summary.counts["images_with_pose"] == 2
        assert summary.counts["tie_points"] == 3
        assert summary.counts["tie_observations"] == 6
        assert summary.counts["tie_points_with_start"] == 2
        assert summary.counts["control"] == 1 and summary.counts["check"] == 1
        assert summary.multiplicity == {1: 1, 2: 1, 3: 1}
        assert summary.observations_per_image == {"min": 2.0, "median": 3.0, "max": 3.0}
        assert summary.points_seen_once == ["once"]
        assert summary.few == {"007": 3, "i2": 3, "i3": 2}

    def test_ground_pixel_is_height_over_focal_length(self, folder):
        # 100 m / 3600 px; the point G1 is 3 m nearer, but the tie points are more.
        assert read(folder).summary().gsd_m == pytest.approx(100 / 3600, rel=1e-12)

    def test_ground_pixel_is_unknown_without_points(self):
        assert small().summary().gsd_m is None

    def test_missing_lists_absent_files_columns_and_camera_values(self, folder):
        (folder / "track.csv").unlink()
        summary = read(folder).summary()
        assert "track" in summary.missing
        assert "images.temperature_c" in summary.missing
        assert "images.time_s" not in summary.missing
        assert "camera.readout_s" not in summary.missing
        assert "camera.readout_s" in read(folder).select(images=["i3"]).summary().missing
        assert summary.known["images.time_s"] == pytest.approx(2 / 3)

    def test_what_cannot_be_tested_is_said_with_its_reason(self, folder):
        needs = {"thermal": ["images.temperature_c"], "clock": ["images.time_s", "gnss.x"]}
        summary = read(folder).summary(needs)
        assert summary.untestable == {"thermal": ["images.temperature_c"]}
        line = next(line for line in str(summary).splitlines() if "temperature_c" in line)
        assert line.split() == "images.temperature_c cannot be tested: thermal".split()

    def test_notes_name_what_hangs_loose(self, folder):
        text = " ".join(read(folder).summary().notes)
        assert "1 tie point is seen in one image only" in text
        assert "1 control or check point is not measured in any image" in text
        (folder / "marks.csv").write_text("point,image,x,y\nG1,007,4000,10\n")
        text = " ".join(read(folder).summary().notes)
        assert "1 control or check point is measured in one image only" in text
        assert "1 observation lies outside its picture" in text

    def test_the_table_in_a_notebook_holds_no_path_and_does_not_change(self, folder):
        (folder / "block.toml").write_text(TOML.replace("two strips", "<two> & strips"))
        shown = read(folder)._repr_html_()
        assert shown == read(folder)._repr_html_()
        assert str(folder.parent) not in shown and " at 0x" not in shown
        assert "&lt;two&gt; &amp; strips" in shown

    def test_it_is_plain_numbers_for_json(self, folder):
        assert json.loads(json.dumps(read(folder).summary().to_dict()))["counts"]["marks"] == 2

    # Images, tie points, observations, marks: the README beside each block.
    @pytest.mark.parametrize(
        ("name", "expected"),
        [
            ("strasbourg", (5, 365, 1149, 47)),
            ("roma", (60, 26321, 90561, 0)),
            ("saraburi/block", (88, 2906, 18324, 24)),
        ],
    )
    def test_counts_of_the_real_blocks(self, real_data, name, expected):
        summary = read(real_data / name).summary()
        keys = ("images", "tie_points", "tie_observations", "marks")
        assert tuple(summary.counts[key] for key in keys) == expected
        assert str(summary).count("\n") > 15

    def test_saraburi_s_ground_pixel_is_that_of_150_m_and_a_35_mm_lens(self, real_data):
        # 150 m above ground, f 8192 px: 18.3 mm; points 10 m below the markers widen it a little.
        gsd = read(real_data / "saraburi/block").summary().gsd_m
        assert gsd == pytest.approx(150 / 8192, rel=0.05)


def test_a_table_whose_first_chunk_is_empty_is_written_as_it_is(tmp_path):
    """Marks alone: points.csv is the empty table of tie points with ground points behind."""
    from corridor.core.block.writing import write_table

    empty = pd.DataFrame({"point": pd.array([], dtype="str"), "x": np.zeros(0)})
    new = pd.DataFrame({"point": pd.array([f"G{k}" for k in range(7)], dtype="str"), "x": 1.0})
    write_table(pd.concat([empty, new], ignore_index=True), tmp_path / "points.csv")
    lines = (tmp_path / "points.csv").read_text().splitlines()
    assert lines == ["point,x", *(f"G{k},1" for k in range(7))]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locale C for file names")
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_path_with_umlauts_is_read_and_written_in_the_locale_c(folder, tmp_path, form):
    """Python's own remedies for that locale are switched off."""
    there = tmp_path / "Bl öcke ü"
    shutil.copytree(folder, there)
    script = "import sys, os; from corridor.core.block import read; " + (
        f"read(sys.argv[1]).write(sys.argv[1] + '2', form={form!r}); read(sys.argv[1] + '2')"
    )
    poor = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    root = str(Path(corridor.__file__).parents[1])
    subprocess.run(
        [sys.executable, "-c", script, str(there)], check=True,
        env=os.environ | poor | {"PYTHONPATH": root},
    )  # fmt: skip
    assert (tmp_path / "Bl öcke ü2" / f"images.{form}").is_file()
