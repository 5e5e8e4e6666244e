"""The page of a diagnosis, its sentence, and what stands beside it."""

import json
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from believing import flown
from strips import corridor_block

import corridor
from corridor.core.effects import Values, correct, find
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.diagnosis import corrected, diagnose
from corridor.diagnosis.findings.findings import Estimate, Unknown
from corridor.diagnosis.report import folder as writing
from corridor.diagnosis.report import tables
from corridor.diagnosis.report.sentence import seen_best, sentence
from corridor.diagnosis.report.wording import placed, scaled, to_add, two_digits, value_and_sigma
from corridor.diagnosis.verification import verification
from corridor.diagnosis.verification.halves import Halves

READOUT = 0.025


@pytest.fixture(scope="module")
def block():
    """A rolling shutter hidden in 24 images, with columns that corridor does not know."""
    made = flown({"rolling_shutter": {"readout": READOUT}}, images=24)
    made.images["pilot"] = "Ada"
    made.tie_points["detector"] = "sift"
    return made


@pytest.fixture(scope="module")
def diagnosis(block):
    return diagnose(block)


@pytest.fixture(scope="module")
def saved(diagnosis, tmp_path_factory):
    """The folder of a diagnosis, counterparts and page included."""
    out = tmp_path_factory.mktemp("results") / "shutter"
    written = diagnosis.save(out, 19, threads=2, command="corridor diagnose BLOCK -o OUT")
    return out, written


@pytest.fixture
def quick(monkeypatch):
    """Saving without the page and the counterparts, which take their time."""

    def none(*arguments):
        raise AdjustmentFailed("no time for it")

    monkeypatch.setattr(sys.modules["corridor.diagnosis.report.beside"], "counterparts", none)
    monkeypatch.setattr(writing, "make_page", lambda found, *_: found.sentence)


class TestPage:
    def test_it_needs_no_other_file_and_no_network(self, saved):
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        assert not re.findall(r"<script|<link|@import|https?://|url\(", page)
        sources = re.findall(r'(?:src|href)="([^"]*)', page)
        assert sources and all(text.startswith("data:image/png;base64,") for text in sources)

    def test_it_opens_with_the_sentence_and_shows_no_code(self, saved, diagnosis):
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        body = page[page.index("<body>") :]
        told = diagnosis.sentence.replace("+-", "±").replace("'", "&#x27;")
        assert body.index(told) < body.index("<h2>") < body.index("<img")
        assert "page.table" not in body and "import" not in body

    def test_every_picture_on_the_page_is_a_file_too(self, saved):
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        names = re.findall(r'<img alt="([^"]*)', page)
        assert names == [
            "check points", "measured beside simulated", "where maps", "where axes", "evidence",
        ]  # fmt: skip
        assert {f"{name.replace(' ', '_')}.png" for name in names} == {
            path.name for path in saved[0].glob("*.png")
        }

    @pytest.mark.parametrize(
        "heading",
        [
            "Measured beside simulated", "What was found", "Data that the fit has not used",
            "Where", "Evidence of all candidates", "The smallest effect that would have been seen",
            "To test more, add", "Check points before and after",
            "The assumed model", "How to make this page again",
        ],
    )  # fmt: skip
    def test_it_holds_what_a_reader_needs(self, saved, heading):
        assert f"<h2>{heading}</h2>" in (saved[0] / "report.html").read_text(encoding="utf-8")

    def test_a_heading_without_anything_below_it_is_left_out(self, saved):
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        assert "What would separate causes that look alike" not in page

    def test_the_command_and_the_versions_are_there(self, saved):
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        assert "<pre>corridor diagnose BLOCK -o OUT</pre>" in page
        assert np.__version__ in page

    def test_the_first_screen_is_the_answer_and_holds_no_code_name(self, saved, diagnosis):
        """Sentence, what to do, check points before and after on one map; then the evidence."""
        page = (saved[0] / "report.html").read_text(encoding="utf-8")
        first = page[page.index("<body>") : page.index("Measured beside simulated")]
        assert first.index("<ol>") < first.index('alt="check points"') < first.index("Data that")
        commands = re.findall("<code>(.*?)</code>", first)
        assert commands == ["corridor adjust BLOCK --effect rolling_shutter -o OUT2"]
        assert "rolling_shutter" not in re.sub("<code>.*?</code>|<td.*?</td>", "", first)
        assert "deviations²" not in page and "tie size" not in page


class TestAnswer:
    def test_at_most_three_actions_lead_with_what_was_found(self, diagnosis):
        assert 1 <= len(diagnosis.actions) <= 3
        assert "`corridor adjust BLOCK --effect rolling_shutter -o OUT2`" in diagnosis.actions[0]
        assert diagnosis.to_dict()["actions"] == diagnosis.actions

    @pytest.mark.parametrize("slug", ["rolling_shutter", "image_deformation", "focal_drift"])
    def test_a_command_is_advised_that_runs(self, diagnosis, block, slug, monkeypatch):
        """Beside a free lens a deformation of the picture needs a prior, which BLOCK has not."""
        monkeypatch.setattr(diagnosis, "used", [slug])
        (step,) = [one for one in diagnosis.actions if "OUT/block" in one]
        if f"--effect {slug}" in step:
            assert corridor.adjust(block, effects=slug, max_iterations=1).effects["slug"][0] == slug
        else:
            with pytest.raises(InputError, match="hold the camera"):
                corridor.adjust(block, effects=slug)

    def test_what_is_probably_a_mistake_in_the_block_comes_first(self, diagnosis, monkeypatch):
        monkeypatch.setattr(diagnosis, "doubts", ["gnss.csv has x and y exchanged.", "other"])
        first, *others = diagnosis.actions
        assert first.startswith("Correct the block first") and first.endswith("y exchanged.")
        assert len(others) <= 2

    def test_a_wrong_control_point_is_to_be_surveyed_again(self, diagnosis, monkeypatch):
        axes = [{"name": "x", "value": 0.06, "sigma": 0.004, "unit": "m"}]
        one = Estimate("control_blunder", "named", 9.0, axes, where={"point": "P7"})
        monkeypatch.setattr(diagnosis.findings, "effects", [one])
        monkeypatch.setattr(diagnosis, "used", ["control_blunder.P7"])
        assert "survey control P7 again" in diagnosis.actions[0]
        assert re.search("`corridor adjust BLOCK --control [^ ]+ -o OUT2`", diagnosis.actions[0])
        assert "--effect" not in " ".join(diagnosis.actions)

    @pytest.mark.parametrize(("share", "said"), [(1.2, "Good enough"), (0.8, "Not good enough: ")])
    def test_it_says_whether_what_is_required_is_reached(self, diagnosis, monkeypatch, share, said):
        monkeypatch.setattr(diagnosis, "required", share * diagnosis.gap["check_m"]["after"])
        assert str(diagnosis).startswith(said)

    def test_in_a_list_it_is_one_line_with_its_verdict(self, diagnosis):
        assert (
            repr(diagnosis) == f"Diagnosis of {diagnosis.block.name}: named. {diagnosis.sentence}"
        )


class TestJson:
    def test_it_holds_what_the_design_promises(self, saved):
        result = json.loads((saved[0] / "diagnosis.json").read_text(encoding="utf-8"))
        promised = "verdict effects unknown untestable detection_limits gap rounds"
        assert set(promised.split()) <= set(result)
        (found,) = result["effects"]
        promised = "slug class log_evidence parameters cannot_be_told_apart_from"
        assert set(promised.split()) <= set(found)
        assert set(found["parameters"][0]) >= {"name", "value", "sigma", "unit"}
        assert set(result["gap"]) == {"tie_px", "check_m", "gnss_m"}

    def test_every_file_is_listed_and_there(self, saved):
        out, written = saved
        result = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
        there = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
        assert set(result["files"]) == there == {p.relative_to(out).as_posix() for p in written}

    def test_the_counterparts_close_when_the_effect_is_added(self, saved):
        """Must show 9: at least one statistic leaves before, and the excess falls by 90 %."""
        result = json.loads((saved[0] / "diagnosis.json").read_text(encoding="utf-8"))
        before, after = result["counterparts"]["before"], result["counterparts"]["after"]
        assert before["leaving"] and after["gap"] < 0.1 * before["gap"]


class TestBlocks:
    def test_the_adjusted_block_is_one(self, saved, diagnosis):
        adjusted = corridor.read(saved[0] / "block")
        given = diagnosis.after.block.images[["x", "y", "z"]].to_numpy()
        assert adjusted.images[["x", "y", "z"]].to_numpy() == pytest.approx(given, abs=1e-9)

    def test_nothing_is_missing_from_the_corrected_one(self, saved):
        """What is left of 25 ms of readout is below its sigma, some 0.5 ms."""
        corrected = corridor.read(saved[0] / "corrected")
        again = diagnose(corrected, only=["rolling_shutter", "affine_distortion", "gnss_bias"])
        assert again.verdict == "nothing"
        refitted = corridor.adjust(corrected, camera="fraser10", effects=["rolling_shutter"])
        (left,) = refitted.effects.itertuples()
        assert abs(left.value) < left.sigma

    def test_what_corridor_does_not_know_is_passed_on(self, saved, block):
        corrected = corridor.read(saved[0] / "corrected")
        assert set(corrected.images["pilot"]) == {"Ada"}
        assert list(corrected.tie_points["point"]) == list(block.tie_points["point"])
        assert set(corrected.tie_points["detector"]) == {"sift"}

    def test_it_says_what_was_taken_out(self, saved, diagnosis):
        (found,) = diagnosis.effects
        record = corridor.read(saved[0] / "corrected").extra["corrected"]
        value = found["parameters"][0]["value"]
        assert record == {"rolling_shutter": {"readout": pytest.approx(value, rel=0.01)}}

    def test_what_one_point_has_keeps_its_name(self, block, diagnosis):
        """The number alone would belong to nobody."""
        point = block.ground["point"][block.ground["role"] == "control"].iloc[0]
        found = {"control_blunder": {"x": {point: 0.05}}}
        after = diagnosis.after
        with_blunder = SimpleNamespace(
            system=after.system, block=after.block, values=Values.of(block, found)
        )
        done = corrected(block, with_blunder, ["control_blunder"])
        assert done.extra["corrected"] == found

    def test_it_is_not_taken_out_twice(self, saved):
        corrected = corridor.read(saved[0] / "corrected")
        with pytest.raises(InputError, match="rolling_shutter has been taken out of this block"):
            correct(corrected, {"rolling_shutter": {"readout": 0.02}})

    def test_start_values_stay_as_they_were(self, saved, block):
        corrected = corridor.read(saved[0] / "corrected")
        columns = ["x", "y", "z", "qw", "qx", "qy", "qz"]
        assert corrected.images[columns].to_numpy() == pytest.approx(
            block.images[columns].to_numpy(), abs=1e-12
        )


class TestWriting:
    def test_counterparts_that_fail_are_a_note_and_no_end(self, diagnosis, tmp_path, quick):
        diagnosis.save(tmp_path / "out")
        result = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
        assert any("no time for it" in note for note in result["notes"])
        assert result["counterparts"] == {"before": None, "after": None}

    def test_an_earlier_result_is_replaced_and_the_readers_own_files_stay(
        self, diagnosis, tmp_path, quick
    ):
        out = tmp_path / "out"
        diagnosis.save(out)
        (out / "my notes.txt").write_text("keep")
        (out / "report.html").write_text("old")
        diagnosis.save(out)
        assert (out / "report.html").read_text(encoding="utf-8") == diagnosis.sentence
        assert (out / "my notes.txt").read_text() == "keep"

    @pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left")])
    def test_interrupted_it_leaves_nothing(self, diagnosis, tmp_path, quick, monkeypatch, error):
        def stop(*arguments):
            raise error

        monkeypatch.setattr(writing, "make_page", stop)
        with pytest.raises((KeyboardInterrupt, OSError)):
            diagnosis.save(tmp_path / "new" / "out")
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_that_holds_something_else_is_refused(self, diagnosis, tmp_path):
        (tmp_path / "thesis.tex").write_text("years of work")
        with pytest.raises(InputError, match=r"without diagnosis.json.*name a new folder"):
            diagnosis.save(tmp_path)

    def test_what_is_only_suspected_changes_no_block(self, block, tmp_path, quick, monkeypatch):
        """A size that cannot be told makes a suspicion of what was found, and of nothing more."""
        monkeypatch.setattr(verification, "untold", lambda *_: "nobody knows how much it is")
        found = diagnose(block, only="rolling_shutter")
        assert [one["class"] for one in found.effects] == ["suspected"] and not found.used
        found.save(tmp_path / "out")
        corrected = corridor.read(tmp_path / "out" / "corrected")
        given = found.block.tie_points[["x", "y"]].to_numpy()
        assert np.array_equal(corrected.tie_points[["x", "y"]].to_numpy(), given)
        result = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
        assert result["written"] == []


def told(
    verdict, effects=(), unknown=(), check=(0.0195, 0.0041), tie=(0.279, 0.272), limits=None,
    p_nothing=0.46,
):  # fmt: skip
    """The sentence of a diagnosis that was never made."""
    return sentence(
        SimpleNamespace(
            verdict=verdict, block=None, level=0.01, alarms=[], untestable=[], check_sigmas=None,
            p_nothing=p_nothing, halves=Halves(),
            course=SimpleNamespace(candidates=SimpleNamespace(effects=[]), unasked=""),
            findings=SimpleNamespace(effects=list(effects), unknown=list(unknown)),
            detection_limits=limits or {},
            gap={
                "check_m": check and dict(zip(("before", "after"), check, strict=True)),
                "tie_px": dict(zip(("before", "after"), tie, strict=True)),
            },
        )
    )  # fmt: skip


def shutter(kind="named", **options):
    values = {"name": "readout", "value": 0.0248, "sigma": 0.0005, "unit": "s"}
    return Estimate("rolling_shutter", kind, 812.4, [values], **options)


class TestSentence:
    def test_it_is_the_one_of_the_issue(self):
        assert told("named", [shutter()]) == (
            "The camera's rolling shutter is missing from the model: readout 24.80 +- 0.50 ms. "
            "Adding it lowers the check-point error from 19.5 to 4.1 mm."
        )

    def test_two_effects_are_named_together(self):
        drift = {"name": "rate", "value": 0.01, "sigma": 0.001, "unit": "px/s"}
        both = [shutter(), Estimate("focal_drift", "named", 40.0, [drift])]
        text = told("named", both)
        assert "are missing from the model. Adding them lowers" in text
        assert "rate 6.00 +- 0.60 px per 10 min" in text

    def test_an_effect_of_one_control_point_says_which(self):
        axes = [
            {"name": axis, "value": value, "sigma": 0.004, "unit": "m"}
            for axis, value in (("x", 0.06), ("y", -0.05), ("z", 0.001))
        ]
        text = told(
            "named", [Estimate("control_blunder", "named", 9.0, axes, where={"point": "P7"})]
        )
        assert text.startswith(
            "An error in the given coordinates of control point P7 is missing from the model: "
            "x 60.0 +- 4.0, y -50.0 +- 4.0 mm."
        )

    def test_look_alikes_are_both_told_and_what_would_separate_them(self):
        one = shutter(
            "ambiguous", alternatives=["affine_distortion"], separate="strips flown across"
        )
        text = told("ambiguous", [one])
        assert text.startswith("Either the camera's rolling shutter (readout 24.80 +- 0.50 ms) or ")
        assert find("affine_distortion").called in text
        assert "this flight cannot separate them. What would: strips flown across." in text

    def test_values_of_flights_stand_together(self):
        flights = [
            Estimate(
                "focal_per_flight", "ambiguous", 50.0,
                [{"name": "f", "value": value, "sigma": 0.07, "unit": "px"}],
                ["focal_drift"], "two heights", {"flight": name},
            )
            for name, value in (("F1", -3.36), ("F2", 3.36))
        ]  # fmt: skip
        either = (
            "a focal length of its own in each flight (F1: f -3.360 +- 0.070 px; "
            "F2: f 3.360 +- 0.070 px) or a drift of the focal length with time"
        )
        assert told("ambiguous", flights).startswith(f"Either {either} is missing from the model")
        assert f"Beside it, either {either}." in told("named", [shutter(), *flights])

    def test_the_unknown_is_described_by_its_place(self):
        one = Unknown("image_deformation", "unknown", 55.0, "largest at x = 3000 px")
        text = told("unknown", unknown=[one])
        assert text.startswith("Something outside the catalogue is missing from the model: ")
        assert "largest at x = 3000 px" in text and "lowers the check-point error" in text
        useless, impossible = replace(one, correction="useless"), replace(one, correction="none")
        assert "does not help" in told("unknown", unknown=[useless])
        assert "nothing was added" in told("unknown", unknown=[impossible])
        alike = replace(one, alike=["gnss_bias"])
        assert "check points separate them" in told("unknown", unknown=[alike])

    def test_a_suspicion_is_not_a_finding(self):
        text = told("suspected", [shutter("suspected")])
        assert text.startswith("Nothing is missing for certain; suspected is the camera's rolling")
        assert "lowers" not in text

    def test_nothing_comes_with_what_would_have_been_seen(self):
        limits = {"rolling_shutter": {"readout": 0.004}, "gnss_bias": {"x": None}}
        assert told("nothing", limits=limits) == (
            "Nothing is missing from the model that this flight could show. Would have "
            "been seen: the camera's rolling shutter from readout 4.0 ms on. "
            "If nothing is missing, signs as strong come by chance: p = 0.46."
        )

    def test_what_only_all_tests_together_show_is_no_claim_that_something_is_missing(self):
        text = told("nothing", p_nothing=0.0004)
        assert (
            "But all tests together show more than chance does (p < 0.001): something may" in text
        )
        assert "come by chance" not in text

    @pytest.mark.parametrize(
        ("check", "tie", "words"),
        [
            ((0.010, 0.0101), (0.30, 0.30), "leaves the check-point error at 10.1 mm."),
            (
                (0.010, 0.015),
                (0.30, 0.30),
                "changes the check-point error from 10.0 to 15.0 mm, which is within its noise.",
            ),
            ((0.010, 0.010), (0.42, 0.34), "and lowers the error of image points held out"),
            (None, (0.42, 0.34), "lowers the error of image points held out from 0.420 to 0.340"),
            (None, (None, None), "could not be measured"),
        ],
    )
    def test_no_improvement_is_promised_that_the_numbers_do_not_show(self, check, tie, words):
        text = told("named", [shutter()], check=check, tie=tie)
        assert words in text
        assert ("lowers the check-point" in text) is False


class TestWording:
    @pytest.mark.parametrize(
        ("unit", "value", "expected"),
        [
            ("s", 0.0248, ("24.80", "0.50", "ms")),
            ("m", 0.060, ("60.0", "1.2", "mm")),
            ("m/s", 0.1 / 600, ("100.0", "2.0", "mm per 10 min")),
            ("1", 300e-6, ("300.0", "6.0", "ppm")),
            ("1", 1.1, ("1.100", "0.022", "")),
            # 1 degree is 3600 arc seconds.
            ("rad", np.radians(0.01), ("36.00", "0.73", "arc seconds")),
        ],
    )
    def test_numbers_are_in_units_of_the_field(self, unit, value, expected):
        sigma = {"24.80": 0.0005}.get(expected[0], value / 50)
        told = value_and_sigma({"value": value, "sigma": sigma, "unit": unit})
        assert told[0] == expected[0] and told[2] == expected[2]
        assert float(told[1]) == pytest.approx(float(expected[1]), rel=0.02)

    def test_two_digits_and_no_power_of_ten(self):
        assert [two_digits(v) for v in (0.00412, 4.12, 1234.0, 0.0)] == [
            "0.0041", "4.1", "1,200", "0",
        ]  # fmt: skip

    def test_every_unit_of_the_catalogue_can_be_told(self):
        block = flown(images=12)
        for effect in corridor.catalogue():
            for parameter in effect.parameters(block):
                factor, unit = scaled(parameter.unit, parameter.scale)
                assert factor >= 1 and unit not in ("s", "m", "rad", "px/s")

    def test_a_place_takes_the_place_of_the_general(self):
        assert (
            placed("an error of a control point", {"point": "P7"}) == "an error of control point P7"
        )
        assert placed("a focal length", {"camera": "left"}) == "a focal length of camera left"
        assert placed("an arm in each flight", {"flight": "F2"}) == "an arm in flight F2"

    @pytest.mark.parametrize(
        ("missing", "words"),
        [
            ("images.time_s", "time_s in images.csv for every image"),
            ("images.vx, images.vy, images.vz", "vx, vy and vz in images.csv for every image"),
            ("gnss.x", "antenna positions (gnss.csv"),
            ("ground.role", "control points"),
            ("camera.P1.calibrated", "calibrated = true for camera P1"),
            ("images.flight", "a second flight"),
            ("tie points in four images or more", "tie points in four images or more"),
        ],
    )
    def test_what_is_missing_is_told_as_what_to_add(self, missing, words):
        assert words in to_add(missing)


def test_a_table_escapes_what_a_surveyor_may_have_typed():
    from corridor.diagnosis.report.page import html_table

    page = html_table(pd.DataFrame({"point": ["<b>P7</b>"], "mm": ["1.2 +- 0.1"]}))
    assert "<b>" not in page and "1.2 ± 0.1" in page


def test_limits_are_told_of_a_rotation_that_a_gyroscope_measures():
    """With rates.csv it is a readout and a delay, where it is a rotation an image without."""
    block = corridor_block(images=6, seed=1)
    time = np.linspace(block.images["time_s"].min(), block.images["time_s"].max(), 50)
    block.rates = pd.DataFrame({"time_s": time, "wx": 0.1, "wy": 0.0, "wz": 0.0})
    limits = {"rolling_shutter_rotation": {"readout": 0.004, "delay": None}}
    found = SimpleNamespace(
        block=block, detection_limits=limits, findings=SimpleNamespace(effects=[])
    )
    told = tables.limits(found)
    assert told["parameter"].tolist() == ["readout", "delay"]
    assert told["smallest seen"].tolist() == ["4.0", "not visible"]
    assert seen_best(found)
