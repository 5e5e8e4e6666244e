"""What is said of an adjustment, and that a saved result is there whole or not at all."""

import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from made_up import adjustment, corridor
from matplotlib.figure import Figure
from strips import corridor_block

import corridor as package
from corridor.core.output import millimetres, rounded
from corridor.interface import report

READOUT = ("rolling_shutter", "readout", "block", 0.0248, 0.00051, "s")


@pytest.fixture(scope="module")
def block():
    return corridor(images=8, ground=7)


def text_of(made):
    return str(report.of_adjustment(made))


def html_of(made):
    return report.of_adjustment(made).html()


def tables_of(made):
    return report.of_adjustment(made).tables


def opening_of(made):
    return report.of_adjustment(made).opening


def many(count):
    return [("focal", "f", f"DJI_{k:04d}.JPG", 0.1 * k, 0.05, "px") for k in range(count)]


class TestRounding:
    @pytest.mark.parametrize(
        ("value", "sigma", "said"),
        [
            (8187.1432, 2.876, ("8187.1", "2.9")),
            (8076.4, 131.2, ("8076", "131")),
            (-0.0493123, 0.000118, ("-0.04931", "0.00012")),
            (1.23456789e-10, 2.5e-12, ("1.235e-10", "2.5e-12")),
            (0.5, 0.0996, ("0.50", "0.10")),
            (-0.0001, 0.05, ("0.000", "0.050")),
            (8192.0, 0.0, ("8192", "held")),
            (8192.123456, float("nan"), ("8192.12", "unknown")),
            (float("nan"), 1.0, ("\u2013", "\u2013")),
        ],
    )
    def test_the_last_digit_is_the_second_of_the_sigma(self, value, sigma, said):
        assert rounded(value, sigma) == said

    def test_a_coefficient_below_one_is_not_written_as_one(self, block):
        pairs = [{"a": "camera.P1.f", "b": "gnss_bias.z", "value": 0.99996}]
        assert "0.999960" in text_of(adjustment(block, high_correlations=pairs))


class TestText:
    def test_no_line_is_longer_than_100_columns_whatever_the_names(self, block):
        long = "a_name_that_somebody_found_descriptive_" * 4
        ground = block.ground.assign(point=[f"{long}{k}" for k in range(len(block.ground))])
        named = dataclasses.replace(block, name=long, ground=ground, marks=None)
        made = adjustment(named, effects=[(long, "readout", long, 0.0248, 0.00051, "s")])
        made.warnings = ["A long sentence about " + "quantities " * 40 + "ends here."]
        pair = {"a": long, "b": long, "mean": 0.3, "std": 0.1}
        made.correlations = pd.DataFrame([pair | {"sigma_a": 1.2345e-9, "sigma_b": 123456.0}])
        made.high_correlations = pd.DataFrame([{"a": long, "b": long, "value": 0.97}])
        made.lever_arm = pd.DataFrame(
            [(long, -0.512, 0.12345, 1234.5, 0.00012, 0.0034, 0.1, False)],
            columns=["flight", "x", "y", "z", "sx", "sy", "sz", "fixed"],
        )
        lines = text_of(made).splitlines()
        assert max(map(len, lines)) <= 100
        assert any(line.rstrip().endswith("0.97") or "0.970" in line for line in lines)

    def test_it_opens_with_what_a_surveyor_wants_to_know(self, block):
        made = adjustment(block)
        opening = " ".join(text_of(made).split("\n\n")[0].split())
        assert opening.startswith("The adjustment of thin (16 images) converged in 5 iterations.")
        assert "Sigma naught is 0.931" in opening and "7 % smaller" in opening
        rms = made.check_rms
        assert f"{1e3 * rms.xy:.0f} mm horizontally and {1e3 * rms.z:.0f} mm in height" in opening

    @pytest.mark.parametrize(
        ("sigma0", "said"),
        [
            (1.0, "as large as the stated"),
            (1.18, "18 % larger"),
            (0.58, "42 % smaller"),
            (3.4, "3.4 times"),
        ],
    )
    def test_sigma_naught_is_put_into_words(self, block, sigma0, said):
        assert said in opening_of(adjustment(block, sigma0=sigma0))

    def test_a_failure_to_converge_is_the_first_thing_said(self, block):
        text = opening_of(adjustment(block, converged=False, iterations=50))
        assert "did not converge in 50 iterations" in text and "not a result" in text

    def test_absence_of_check_points_is_said(self, block):
        made = adjustment(dataclasses.replace(block, ground=None, marks=None))
        assert "no check points" in text_of(made)
        assert "Check points" not in [table.title for table in tables_of(made)]

    def test_every_number_of_the_tables_is_there(self, block):
        made = adjustment(block, effects=[READOUT])
        text = text_of(made)
        tie = made.statistics["tie"]
        assert f"{tie['count']:,}" in text and f"{tie['rms']:.3f} px an axis" in text
        assert f" {tie['outliers']:,} " in text
        assert re.search(r"f +8192\.0 +2\.9 +px", text)
        assert re.search(r"rolling_shutter +readout +block +24\.80 +0\.51 +ms +48\.6", text)
        assert "redundancy 27,340" in text
        for name in made.check_points["point"]:
            assert name in text
        xy, z, d3 = (f"{1e3 * value:.0f}" for value in made.check_std)
        assert re.search(rf"STD +{xy} +{z} +{d3}\n", text)

    def test_a_parameter_that_may_be_zero_is_named(self, block):
        made = adjustment(block)
        note = next(t for t in tables_of(made) if t.title == "Camera P1").notes[0]
        assert note.startswith("k2, k3, p1, p2 differ from zero by less than two")
        assert "k1" not in note

    def test_a_camera_held_fixed_is_said_to_be_held(self, block):
        made = adjustment(block)
        made.camera = made.camera.assign(sigma=0.0, free=False)
        table = next(t for t in tables_of(made) if t.title == "Camera P1")
        assert table.rows[0] == ("f", "8192", "held", "px") and not table.notes
        assert [row[0] for row in table.rows] == ["f", "cx", "cy", "k1"]  # the zeros say nothing

    def test_gross_errors_left_out_of_the_rms_are_said_and_nothing_else_is(self, block):
        """Outliers stay in the RMS; only what lies beyond 15 robust sigmas is left out."""
        made = adjustment(block)
        table = tables_of(made)[0]
        assert made.statistics["tie"]["outliers"] and "RMS" in table.header
        assert not [note for note in table.notes if "gross" in note]
        made.statistics["mark"]["gross"] = 3
        assert tables_of(made)[0].notes[0].endswith("beyond 15 robust sigmas: 3 of marks")

    def test_correlations_left_out_are_counted(self, block):
        pairs = [{"a": f"a{k}", "b": f"b{k}", "value": -0.951 - 0.001 * k} for k in range(30)]
        text = text_of(adjustment(block, high_correlations=pairs))
        assert "18 further pairs above it left out" in text
        assert "a29" in text and "a0 " not in text  # strongest first

    def test_no_strong_correlation_is_said_too(self, block):
        assert "none of the 8 parameters' correlations is above 0.95" in text_of(
            adjustment(block, high_correlations=[])
        )

    def test_the_sigma_of_a_check_point_is_that_of_the_table(self, block):
        """One name, one number: in check_points.csv, in adjustment.json and on the page."""
        table = next(t for t in tables_of(adjustment(block)) if t.title == "Check points")
        assert {row[4:7] for row in table.rows} == {("17", "11", "56")}

    @pytest.mark.parametrize(("required", "said"), [(0.5, "Good enough: "), (1e-3, "Not good")])
    def test_it_says_first_whether_it_is_good_enough(self, block, required, said):
        made = adjustment(block, required=required)
        assert opening_of(made).startswith(said) and "3D RMS" in opening_of(made)
        assert report.adjustment_dict(made)["required"] == required

    def test_whether_it_is_good_enough_nobody_knows_without_check_points(self, block):
        made = adjustment(dataclasses.replace(block, ground=None, marks=None), required=0.02)
        assert opening_of(made).startswith("Whether it is good enough is not known: 20 mm")
        assert "survey points on the ground" in " ".join(report.of_adjustment(made).actions)

    def test_at_most_three_actions_are_numbered_and_no_command_is_broken(self, block):
        made = adjustment(block, required=1e-3, sigma0=2.0)
        made.residuals["tie"].loc[0, "outlier"] = True
        actions = report.of_adjustment(made).actions
        assert len(actions) == 3 and "`corridor diagnose BLOCK -o OUT`" in actions[0]
        lines = text_of(made).splitlines()
        assert [line[:5] for line in lines if re.match(r"  \d\. ", line)] == [
            "  1. ", "  2. ", "  3. ",
        ]  # fmt: skip
        assert any("`corridor diagnose BLOCK -o OUT`" in line for line in lines)
        assert html_of(made).count("<li>") == 3

    def test_errors_within_their_sigmas_ask_for_no_diagnosis_and_five_times_them_do(self, block):
        """Errors of one standard deviation are what chance gives; five are not."""
        asks = []
        for times in (1.0, 5.0):
            made = adjustment(block)
            sigma = made.check_points[["s_dx", "s_dy", "s_dz"]].to_numpy()
            made.check_points[["dx", "dy", "dz"]] = times * sigma
            asks.append("diagnose" in " ".join(report.of_adjustment(made).actions))
        assert asks == [False, True]

    @pytest.mark.parametrize(
        ("metres", "said"),
        [
            (0.00957, "10 mm"),
            (0.00484, "5 mm"),
            (0.00084, "0.84 mm"),
            (1.512, "1.51 m"),
            (0.0, "0 mm"),
            (0.9999, "1.00 m"),
            (0.999, "999 mm"),
        ],
    )
    def test_a_length_has_the_digits_that_count(self, metres, said):
        assert millimetres(metres) == said

    def test_check_points_left_out_are_counted_and_the_largest_shown(self):
        made = adjustment(corridor(images=8, ground=60))
        made.check_points["dz"] = np.arange(len(made.check_points)) / 1000
        table = next(t for t in tables_of(made) if t.title == "Check points")
        assert len(table.rows) == 20
        assert f"{len(made.check_points) - 20} smaller ones left out" in " ".join(table.notes)
        assert table.rows[-1][0] == made.check_points["point"].iloc[-1]

    def test_warnings_stand_at_the_top_as_whole_sentences(self, block):
        sentence = "focal length and height cannot be separated by these images and this GNSS"
        text = text_of(adjustment(block, warnings=[sentence]))
        opening, _, actions = " ".join(text.split("\n\n")[0].split()).partition(" 1. ")
        assert opening.endswith("! " + sentence) and actions

    def test_the_report_holds_no_time(self, block):
        quick, slow = (adjustment(block, seconds=s) for s in (0.31, 456.789))
        assert text_of(quick) == text_of(slow)
        assert html_of(quick) == html_of(slow)


class Rows(HTMLParser):
    """The texts of all table cells; fails on a tag that is not closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells, self.tags = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in ("img", "meta"):
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data


class TestHtml:
    def test_it_holds_the_same_cells_as_the_text(self, block):
        made = adjustment(block, effects=[READOUT])
        cells = [
            cell
            for table in tables_of(made)
            if table.rows
            for row in (table.header, *table.rows)
            for cell in row
        ]
        assert Rows(html_of(made)).cells == cells

    def test_names_cannot_break_out_of_their_cells(self, block):
        name = "<script>alert('x')</script> & co"
        ground = block.ground.assign(point=[f"{name}{k}" for k in range(len(block.ground))])
        made = adjustment(dataclasses.replace(block, name=name, ground=ground, marks=None))
        page = Rows(report.of_adjustment(made).page())
        assert "script" not in [tag for tag, _ in page.tags]

    def test_the_page_needs_no_other_file(self, block):
        page = report.of_adjustment(adjustment(block)).page(
            [("plan", "What it shows.", b"\x89PNG...")]
        )
        for tag, attributes in Rows(page).tags:
            assert tag not in ("script", "link", "iframe")
            source = attributes.get("src") or attributes.get("href")
            assert source is None or source.startswith("data:image/png;base64,")
        assert "What it shows." in page and "url(" not in page


class TestDict:
    def test_it_is_what_the_design_says(self, block):
        made = report.adjustment_dict(adjustment(block, effects=[READOUT]))
        assert {
            "converged", "iterations", "seconds", "sigma0", "redundancy", "observations", "camera",
            "effects", "lever_arm", "check_points", "correlations", "warnings",
        } <= set(made)  # fmt: skip
        assert made["camera"]["P1"]["f"] == {"value": 8192.0, "sigma": 2.9}
        assert made["effects"] == {
            "rolling_shutter": {"readout": {"value": 0.0248, "sigma": 0.00051, "unit": "s"}}
        }
        assert made["lever_arm"]["1"]["x"] == {"value": 0.0, "sigma": 0.0}
        assert set(made["observations"]) >= {"tie", "mark", "gnss", "control"}
        assert isinstance(made["observations"]["tie"]["rms"], float)
        assert len(made["observations"]["gnss"]["rms"]) == 3
        assert set(made["check_points"]) == {"rows", "rms", "mean", "std"}
        assert set(made["check_points"]["rms"]) == {"xy", "z", "3d"}
        assert {"point", "dx", "dy", "dz"} <= set(made["check_points"]["rows"][0])

    def test_groups_stand_between_slug_and_parameter(self, block):
        effects = [("gnss_bias", axis, flight, 0.1, 0.01, "m") for flight in "AB" for axis in "xyz"]
        found = report.adjustment_dict(adjustment(block, effects=effects))["effects"]["gnss_bias"]
        assert list(found) == ["A", "B"] and list(found["A"]) == ["x", "y", "z"]

    def test_more_than_fifty_groups_are_summarised(self, block):
        found = report.adjustment_dict(adjustment(block, effects=many(51)))["effects"]["focal"]["f"]
        assert found["groups"] == 51 and found["table"] == "effect_focal.csv"
        assert found["mean"] == pytest.approx(2.5) and found["max"] == pytest.approx(5.0)
        fifty = report.adjustment_dict(adjustment(block, effects=many(50)))["effects"]["focal"]
        assert len(fifty) == 50

    def test_numbers_are_finite_or_null(self, block):
        made = adjustment(block, sigma0=float("nan"), cost=float("inf"))
        made.camera.loc[0, "sigma"] = float("inf")
        made.statistics["control"] = {"count": 0, "rms": np.full(3, np.nan), "outliers": 0}
        made.check_points = made.check_points.iloc[:0]
        unknown = type(made.check_rms)(*[float("nan")] * 3)
        made.check_statistics = type(made.check_statistics)(unknown, unknown, unknown)
        found = report.adjustment_dict(made)
        text = json.dumps(found, allow_nan=False)
        assert json.loads(text) == found
        assert found["sigma0"] is None and found["camera"]["P1"]["f"]["sigma"] is None
        assert found["check_points"]["rms"] == {"xy": None, "z": None, "3d": None}
        assert found["check_points"]["rows"] == []


class TestSave:
    def files(self, folder):
        return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()}

    def test_everything_is_there_and_nothing_else(self, block, tmp_path):
        made = adjustment(block, effects=many(60))
        made.residuals["tie"].loc[0, "outlier"] = True
        out = tmp_path / "out" / "first"
        written = report.save_adjustment(made, out)
        names = self.files(out)
        assert {p.relative_to(out).as_posix() for p in written} == names
        assert {
            "adjustment.json", "report.html", "check_points.csv", "poses.csv", "outliers.csv",
            "effect_focal.csv", "block/block.toml", "block/images.csv",
        } <= names  # fmt: skip
        content = json.loads((out / "adjustment.json").read_text())
        assert content["sigma0"] == made.sigma0
        assert set(content["files"]) == names
        assert [p.name for p in (tmp_path / "out").iterdir()] == ["first"]

    def test_the_saved_block_can_be_read_again(self, block, tmp_path):
        report.save_adjustment(adjustment(block), tmp_path / "out")
        again = package.read(tmp_path / "out" / "block")
        assert len(again.images) == len(block.images)

    def test_tables_hold_what_they_say(self, block, tmp_path):
        made = adjustment(block, effects=many(60))
        report.save_adjustment(made, tmp_path / "out")
        focal = pd.read_csv(tmp_path / "out" / "effect_focal.csv")
        assert focal["value"].to_numpy() == pytest.approx(0.1 * np.arange(60))
        outliers = pd.read_csv(tmp_path / "out" / "outliers.csv")
        flagged = made.residuals["tie"]["outlier"].sum() + made.residuals["mark"]["outlier"].sum()
        assert len(outliers) == flagged
        assert (np.diff(np.hypot(outliers["vx"], outliers["vy"]) / outliers["sigma"]) <= 1e-9).all()

    def test_pictures_are_saved_and_shown_in_the_page(self, block, tmp_path):
        report.save_adjustment(
            adjustment(block), tmp_path / "out", {"a_map": Figure()}, {"a_map": "A map."}
        )
        assert (tmp_path / "out" / "a_map.png").read_bytes().startswith(b"\x89PNG")
        page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
        assert "data:image/png;base64," in page and "A map." in page
        content = json.loads((tmp_path / "out" / "adjustment.json").read_text())
        assert content["pictures"] == ["a_map.png"]

    def test_an_earlier_result_is_replaced_and_its_leftovers_go(self, block, tmp_path):
        out = tmp_path / "out"
        report.save_adjustment(adjustment(block, effects=many(60)), out)
        (out / "my notes.txt").write_text("keep me")
        report.save_adjustment(adjustment(block, sigma0=2.0), out)
        assert json.loads((out / "adjustment.json").read_text())["sigma0"] == 2.0
        assert not (out / "effect_focal.csv").exists()
        assert (out / "my notes.txt").read_text() == "keep me"
        assert list(tmp_path.iterdir()) == [out]

    @pytest.mark.parametrize("present", ["a folder with something", "a file", "a block"])
    def test_what_an_adjustment_did_not_write_is_not_touched(self, block, tmp_path, present):
        out = tmp_path / "out"
        if present == "a file":
            out.write_text("precious")
        elif present == "a block":
            block.write(out)
        else:
            out.mkdir()
            (out / "thesis.tex").write_text("precious")
        before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
        with pytest.raises(package.InputError):
            report.save_adjustment(adjustment(block), out)
        assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before

    def test_an_empty_folder_may_be_filled(self, block, tmp_path):
        report.save_adjustment(adjustment(block), tmp_path)
        assert (tmp_path / "adjustment.json").is_file()

    @pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
    @pytest.mark.parametrize("step", ["block", "picture", "json"])
    @pytest.mark.parametrize("earlier", [False, True])
    def test_an_interrupted_run_leaves_what_was_there(
        self, block, tmp_path, monkeypatch, error, step, earlier
    ):
        out = tmp_path / "deep" / "out"
        if earlier:
            report.save_adjustment(adjustment(block, sigma0=3.0), out)
        before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

        def fail(*_, **__):
            raise error

        figure = Figure()
        if step == "block":
            monkeypatch.setattr(type(block), "write", fail)
        elif step == "picture":
            figure.draw = fail
        else:
            monkeypatch.setattr(json, "dumps", fail)
        with pytest.raises(type(error)):
            report.save_adjustment(adjustment(block), out, {"plan": figure})
        assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
        assert earlier or not (tmp_path / "deep").exists()


@pytest.mark.parametrize(
    ("true", "stated", "said"),
    [
        (0.030, 0.033, None),
        (0.030, 0.060, "states 60.0 ms"),
        (-0.030, 0.033, "the rows run the other way"),
    ],
)
def test_the_estimated_readout_is_set_beside_the_stated_one(true, stated, said):
    truth = corridor_block(images=24, strips=4, turned=True, velocity_jitter=0.5)
    block = package.effects.add(truth, {"rolling_shutter": {"readout": true}})
    for name, camera in block.cameras.items():
        block.cameras[name] = dataclasses.replace(camera, readout_s=stated)
    rng = np.random.default_rng(0)
    block.tie_points[["x", "y"]] += rng.normal(0, 0.3, (len(block.tie_points), 2))
    adjusted = package.adjust(block, camera="fixed", effects=["rolling_shutter"])
    assert f"readout: stated {1000 * stated:.1f} ms, estimated " in text_of(adjusted)
    mine = [sentence for sentence in adjusted.warnings if sentence.startswith("A readout of")]
    assert len(mine) == bool(said)
    assert said is None or said in mine[0]
