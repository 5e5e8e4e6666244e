"""`corridor gnss`: what it writes, prints and returns."""

import numpy as np
import pandas as pd
import pytest
from turbulent_flight import fly, observed

from corridor.core import gnss
from corridor.core.errors import InputError, WorkFailed
from corridor.interface.cli import main

SXYZ = ["sx", "sy", "sz"]


@pytest.fixture(scope="module")
def flight():
    return fly(1, strips=2)


@pytest.fixture
def block(flight, tmp_path):
    """A folder with block.toml, images.csv and track.csv, one clock, local metres."""
    folder = tmp_path / "block"
    folder.mkdir()
    (folder / "block.toml").write_text('name = "made up"\n', encoding="utf-8")
    observed(flight, 1, interval=0.5).to_csv(folder / "track.csv", index=False)
    images(folder, np.arange(5.0, 100.0, 2.5))
    return folder


def images(folder, time):
    table = pd.DataFrame({"image": [f"DJI_{k:04d}.JPG" for k in range(len(time))]})
    table.assign(camera="P1", time_s=time).to_csv(folder / "images.csv", index=False)


def run(folder, *more, out=None):
    out = folder / "gnss.csv" if out is None else out
    words = ["gnss", folder / "track.csv", "--images", folder, "-o", out, *more]
    return main([str(word) for word in words])


class TestWhatItWrites:
    def test_table_and_picture_beside_each_other(self, block, flight, capsys):
        assert run(block) == 0
        assert {"gnss.csv", "gnss.png"} < {path.name for path in block.iterdir()}
        table = pd.read_csv(block / "gnss.csv")
        assert list(table.columns) == ["image", "x", "y", "z", *SXYZ]
        assert table["image"].tolist() == [f"DJI_{k:04d}.JPG" for k in range(38)]
        truth = flight.position(np.arange(5.0, 100.0, 2.5))
        off = (table[["x", "y", "z"]].to_numpy() - truth) / table[SXYZ].to_numpy()
        # Five sigma: once in two million numbers.
        assert np.abs(off).max() < 5
        said = capsys.readouterr().out
        assert str(block / "gnss.csv") in said and str(block / "gnss.png") in said
        assert "38 images with antenna, 0 refused" in said

    def test_the_block_reads_it(self, block):
        run(block)
        from corridor.core.block.reading import read_table

        frame, _ = read_table(block, "gnss")
        assert len(frame) == 38 and np.isfinite(frame["sz"]).all()

    def test_refused_images_are_named_and_left_out(self, block, capsys):
        images(block, np.array([-3.0, 20.0, 4000.0]))
        assert run(block, "--max-sigma", "0.5") == 2  # most images lie outside: no common clock
        images(block, np.array([-3.0, 20.0, 30.0, 40.0]))
        assert run(block) == 0
        assert "DJI_0000.JPG: before the track begins" in capsys.readouterr().out
        assert len(pd.read_csv(block / "gnss.csv")) == 3

    def test_an_earlier_result_is_replaced_and_another_table_is_not(self, block, capsys):
        (block / "gnss.csv").write_text("image,x,y,z\nold,1,2,3\n", encoding="utf-8")
        assert run(block, "--method", "linear") == 0
        assert "old" not in set(pd.read_csv(block / "gnss.csv")["image"])
        before = (block / "images.csv").read_bytes()
        assert run(block, out=block / "images.csv") == 2
        assert "is no gnss.csv" in capsys.readouterr().err
        assert (block / "images.csv").read_bytes() == before

    def test_a_folder_gets_gnss_csv_and_a_new_one_is_made(self, block, tmp_path):
        assert run(block, out=block) == 0
        assert (block / "gnss.csv").is_file()
        assert run(block, out=tmp_path / "new" / "deep" / "antenna.csv") == 0
        assert {p.name for p in (tmp_path / "new" / "deep").iterdir()} == {
            "antenna.csv",
            "antenna.png",
        }

    def test_where_the_picture_fails_nothing_stays(self, block, tmp_path, monkeypatch):
        def full(*arguments, **named):
            raise OSError(28, "No space left on device", "gnss.png")

        monkeypatch.setattr("matplotlib.figure.Figure.draw", full)
        assert run(block, out=tmp_path / "new" / "gnss.csv") == 1
        assert not (tmp_path / "new").exists()

    @pytest.mark.parametrize("method", ["spline", "linear"])
    def test_another_method_can_be_asked_for(self, method, block, capsys):
        assert run(block, "--method", method) == 0
        assert f"method: {method}" in capsys.readouterr().out

    def test_times_of_other_images_are_told(self, block, flight, capsys):
        """A column of images.csv is another's: the antennas go a way of their own."""
        table = pd.read_csv(block / "images.csv")
        table[["x", "y", "z"]] = flight.position(table["time_s"].to_numpy())
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        assert "another way" not in capsys.readouterr().err
        table["time_s"] = np.random.default_rng(1).permutation(table["time_s"])
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        assert "each in another direction" in " ".join(capsys.readouterr().err.split())

    def test_a_time_between_its_neighbours_that_is_wrong_is_told(self, block, flight, capsys):
        table = pd.read_csv(block / "images.csv")
        table[["x", "y", "z"]] = flight.position(table["time_s"].to_numpy())
        table[["x", "y", "z"]] += np.random.default_rng(0).normal(0.0, 0.1, (len(table), 3))
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        assert "is its time right?" not in capsys.readouterr().err
        table.loc[5, "time_s"] += 1.5
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        said = " ".join(capsys.readouterr().err.split())
        assert "DJI_0005.JPG lies" in said and "its pose in images.csv" in said

    def test_an_image_at_the_time_of_another_flight_is_told(self, block, flight, capsys):
        track = observed(flight, 1, interval=0.5)
        later = track.assign(time_s=track["time_s"] + 900.0)
        pd.concat([track, later]).to_csv(block / "track.csv", index=False)
        time = np.concatenate([np.arange(5.0, 100.0, 2.5), np.arange(905.0, 1000.0, 2.5)])
        images(block, time)
        table = pd.read_csv(block / "images.csv").assign(flight=np.where(time < 500, "A", "B"))
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        assert "another piece of the track" not in capsys.readouterr().out
        table.loc[5, "time_s"] += 900.0
        table.to_csv(block / "images.csv", index=False)
        assert run(block) == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "DJI_0005.JPG lies in another piece of the track than the other images" in said

    def test_a_track_without_sigmas_gives_a_table_without_them(self, block):
        track = pd.read_csv(block / "track.csv").drop(columns=SXYZ)
        track.to_csv(block / "track.csv", index=False)
        assert run(block, "--method", "parabola") == 0
        assert list(pd.read_csv(block / "gnss.csv").columns) == ["image", "x", "y", "z"]
        assert run(block) == 0
        assert pd.read_csv(block / "gnss.csv")["sx"].between(0.002, 0.03).all()


class TestWhatIsWrong:
    def fails(self, status, sentence, capsys, *run_arguments, **named):
        assert run(*run_arguments, **named) == status
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert sentence in said
        folder = run_arguments[0]
        assert not (folder / "gnss.csv").exists() and not (folder / "gnss.png").exists()

    def test_a_track_in_milliseconds_is_refused(self, block, capsys):
        track = pd.read_csv(block / "track.csv")
        track["time_s"] = 1000 * track["time_s"]
        track.to_csv(block / "track.csv", index=False)
        words = ["gnss", str(block / "track.csv"), "--images", str(block), "-o"]
        assert main([*words, str(block / "out.csv")]) == 2
        assert "is time_s in milliseconds" in capsys.readouterr().err

    def test_no_common_clock_is_refused_not_stretched(self, block, capsys):
        images(block, np.arange(5000.0, 5100.0, 5.0))
        self.fails(2, "no common clock", capsys, block)

    def test_time_backwards_names_the_row(self, block, capsys):
        track = pd.read_csv(block / "track.csv")
        track.loc[10, "time_s"] = 0.5
        track.to_csv(block / "track.csv", index=False)
        self.fails(2, "track.csv, row 12: the time goes back", capsys, block)

    def test_a_sigma_that_is_none_names_the_row(self, block, capsys):
        track = pd.read_csv(block / "track.csv")
        track.loc[10, "sx"] = -0.01
        track.to_csv(block / "track.csv", index=False)
        self.fails(2, "track.csv, row 12: sx = -0.01 is not a standard deviation", capsys, block)

    def test_all_single_is_said(self, block, capsys):
        track = pd.read_csv(block / "track.csv").assign(quality=5)
        track.to_csv(block / "track.csv", index=False)
        self.fails(2, "single positions", capsys, block)

    def test_all_refused_is_a_failure_that_says_why(self, block, capsys):
        sentence = "no position was found for any of the 38 exposures (sigma"
        self.fails(1, sentence, capsys, block, "--max-sigma", "0.0001")

    def test_the_output_is_a_csv(self, block, capsys):
        self.fails(2, "is not a .csv", capsys, block, out=block / "gnss.txt")

    @pytest.mark.parametrize(
        "option", [("--max-sigma", "-1"), ("--slow-share", "1"), ("--method", "x")]
    )
    def test_an_option_out_of_range_is_the_parser_s_to_refuse(self, option, block):
        with pytest.raises(SystemExit) as ended:
            run(block, *option)
        assert ended.value.code == 2


class TestOtherFrames:
    """A track in degrees, for a block in a projected grid with an offset."""

    @pytest.fixture
    def made(self, flight, tmp_path):
        about = gnss.Local(45.85, 5.78, 0.0)
        local = observed(flight, 1, interval=0.2)
        table = local.copy()
        table[["x", "y", "z"]] = about.to_geographic(local[["x", "y", "z"]].to_numpy())
        track = gnss.Track(table, None, None, "EPSG:4979", tmp_path / "rover.pos")
        at = np.arange(5.0, 100.0, 2.5)
        exposures = gnss.Exposures(
            pd.DataFrame({"number": np.arange(len(at)), "time_s": at}),
            None,
            None,
            None,
            tmp_path / "marks.MRK",
        )
        return about, track, exposures, flight.position(at)

    def test_local_metres_have_the_distances_of_the_flight(self, made):
        about, track, exposures, truth = made
        found = gnss.antenna(track, exposures)
        assert found.gnss["image"].tolist()[:2] == ["0", "1"]
        assert "east, north, up about 45.85" in found.frame
        xyz = found.gnss[["x", "y", "z"]].to_numpy()
        assert np.linalg.norm(xyz[-1] - xyz[0]) == pytest.approx(
            np.linalg.norm(truth[-1] - truth[0]), abs=0.05
        )

    def test_the_block_s_crs_and_offset_are_met(self, made):
        about, track, exposures, truth = made
        offset = (916000.0, 6533000.0, 0.0)
        found = gnss.antenna(track, exposures, crs="EPSG:2154", offset=offset)
        wanted = about.to_crs(truth, "EPSG:2154") - offset
        assert np.abs(found.gnss[["x", "y"]].to_numpy() - wanted[:, :2]).max() < 0.04
        assert "EPSG:2154 minus 916000, 6533000, 0" in found.frame

    @pytest.mark.parametrize("crs", ["EPSG:4979", "EPSG:4326", "EPSG:4258"])
    def test_degrees_keep_a_tenth_of_a_millimetre(self, made, tmp_path, crs):
        about, track, exposures, truth = made
        found = gnss.antenna(track, exposures, crs=crs)
        found.save(tmp_path / "degrees.csv")
        table = pd.read_csv(tmp_path / "degrees.csv")
        back = about.from_geographic(table[["x", "y", "z"]].to_numpy())
        assert np.abs(back - about.from_geographic(found.gnss[["x", "y", "z"]])).max() < 1e-4

    @pytest.mark.parametrize(
        ("crs", "said"),
        [("EPSG:2263", "counts in US survey foot"), ("EPSG:4978", "not in metres of a grid"),
         ("EPSG:32759", "lie outside the area of use .* latitude 45.85, longitude 5.7")],
    )  # fmt: skip
    def test_a_system_that_is_not_of_the_place_is_refused(self, made, crs, said):
        _, track, exposures, _ = made
        with pytest.raises(InputError, match=said):
            gnss.antenna(track, exposures, crs=crs)

    def test_block_toml_says_crs_and_offset(self, tmp_path):
        assert gnss.frame_of_block(tmp_path)[0] is None
        text = 'name = "a"\ncrs = "EPSG:2154"\noffset = [1, 2.5, 3]\n'
        (tmp_path / "block.toml").write_text(text, encoding="utf-8")
        crs, offset, _ = gnss.frame_of_block(tmp_path / "images.csv")
        assert crs == "EPSG:2154" and offset.tolist() == [1.0, 2.5, 3.0]
        for wrong in ("[1, 2]", "{}"):
            (tmp_path / "block.toml").write_text(f"offset = {wrong}\n", encoding="utf-8")
            with pytest.raises(InputError, match="block.toml: offset is not three numbers"):
                gnss.frame_of_block(tmp_path)

    def test_no_exposure_left_is_a_failure(self, made):
        _, track, exposures, _ = made
        with pytest.raises(WorkFailed, match="for any of the 38 exposures"):
            gnss.antenna(track, exposures, max_sigma=1e-6)


def test_the_real_flight_gets_an_antenna_at_every_mark(real_data, tmp_path, capsys):
    """GrafNav's 5 Hz track and DJI's marks; the published positions less DJI's offsets."""
    folder = real_data / "m300_ppk"
    words = ["gnss", folder / "grafnav_5hz.txt.gz", "--images", folder / "timestamp.MRK"]
    out = tmp_path / "gnss.csv"
    words += ["--crs", "EPSG:4979", "-o", out]
    assert main([str(word) for word in words]) == 0
    table = pd.read_csv(out)
    assert len(table) == 586
    assert table["sx"].between(0.002, 0.03).all()
    published = pd.read_csv(folder / "published_camera_positions.csv")
    offset = gnss.read_exposures(folder / "timestamp.MRK").table["offset_u"].to_numpy()
    up = published["h_EOP"].to_numpy() - offset - table["z"].to_numpy()
    # Published linearly: the height is within millimetres at 5 Hz.
    assert np.sqrt(np.mean(up**2)) < 0.01
