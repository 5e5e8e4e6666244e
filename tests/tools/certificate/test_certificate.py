"""Certificates: figures by hand, refusals, the same bytes, and every changed byte noticed."""

import io
import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import corridor
from corridor import cli
from corridor.core.simulation import Flight, Ground, Noise, Plan, simulate
from corridor.tools.certificate import certify, certifying, form_names, paper, verify
from corridor.tools.certificate.forms import asprs
from corridor.tools.certificate.statement import CheckPoints

PLAN = Plan(
    "short", (Flight("F1", 50.0, images=10, strips=2),), axis_m=((0.0, 0.0), (0.0, 80.0)),
    ground=Ground(control=4, check=32),
    noise=Noise(tie_px=0.4, mark_px=0.4, gnss_m=(0.02, 0.02, 0.04), control_m=0.005),
)  # fmt: skip


@pytest.fixture(scope="module")
def block():
    made = simulate(PLAN, seed=3)
    made.ground = made.ground.assign(sx=0.004, sy=0.004, sz=0.006)
    return made


@pytest.fixture(scope="module")
def folder(block, tmp_path_factory):
    at = tmp_path_factory.mktemp("certified") / "block"
    block.write(at)
    return at


@pytest.fixture(scope="module")
def adjusted(folder):
    return corridor.adjust(folder)


@pytest.fixture(scope="module")
def made(folder, adjusted):
    return {form: certify(folder, form, adjustment=adjusted) for form in form_names()}


def fewer(block, count):
    """The block with so many check points; the others are not used."""
    ground = block.ground.copy()
    check = np.flatnonzero(ground["role"].astype(str) == "check")
    ground["role"] = ground["role"].astype(object)
    ground.loc[check[count:], "role"] = "unused"
    return block.with_(ground=ground)


def covered(adjusted, cover):
    """What `CheckPoints` sees of an adjustment, with this column `vegetated`."""
    block = adjusted.problem.block
    ground = block.ground.assign(vegetated=block.ground["point"].astype(str).map(cover))
    problem = SimpleNamespace(block=block.with_(ground=ground))
    return SimpleNamespace(check_points=adjusted.check_points, problem=problem)


class TestFigures:
    def test_those_of_asprs_are_those_of_a_calculation_by_hand(self):
        """Two points, 3 and 4 mm off in plan and 2 mm in height, surveyed to 1, 2 and 3 mm."""
        difference = np.array([[0.003, 0.004, 0.002], [-0.003, 0.004, -0.002]])
        survey = np.full((2, 3), [0.001, 0.002, 0.003])
        found = asprs.Errors(difference, survey)
        assert found.fit_h == pytest.approx(0.005) and found.fit_v == pytest.approx(0.002)
        assert found.h == pytest.approx(np.sqrt(25 + 1 + 4) * 1e-3)
        assert found.v == pytest.approx(np.sqrt(4 + 9) * 1e-3)
        assert found.d3 == pytest.approx(np.sqrt(30 + 13) * 1e-3)

    @pytest.mark.parametrize(
        ("km2", "points"), [(0.01, 30), (1000, 30), (1001, 40), (2500, 50), (9001, 120), (9e4, 120)]
    )
    def test_the_number_of_check_points_goes_with_the_area(self, km2, points):
        assert asprs.least_number(km2 * 1e6) == points

    def test_the_record_holds_what_the_adjustment_says(self, made, adjusted):
        found = made["full"].record["figures"]
        assert found["sigma0"] == pytest.approx(adjusted.sigma0, rel=1e-5)
        assert found["check_rms_xy_m"] == pytest.approx(adjusted.check_rms.xy, rel=1e-5)
        assert found["RMSE_H1"] == pytest.approx(adjusted.check_rms.xy, rel=1e-5)

    def test_the_full_form_states_what_authorities_ask_for(self, made):
        text = str(made["full"])
        titles = [
            "Exterior orientation", "Correlations of the camera", "Reliability of control",
            "Variance components", "What was not tested", "Input files",
        ]  # fmt: skip
        assert [title for title in titles if title not in text] == []


class TestClaims:
    def test_a_class_is_claimed_from_thirty_check_points_on(self, made):
        assert "meets the ASPRS accuracy classes of" in made["asprs"].report.opening

    @pytest.mark.parametrize("count", [1, 29])
    def test_with_fewer_there_are_figures_and_no_class(self, block, tmp_path, count):
        fewer(block, count).write(tmp_path / "few")
        said = certify(tmp_path / "few", "asprs").report.opening
        assert said.startswith("No accuracy class is claimed") and str(count) in said
        assert "RMSE_H is" in said and "meets" not in said

    def test_without_a_check_point_no_form_states_an_accuracy_on_the_ground(self, block, tmp_path):
        fewer(block, 0).write(tmp_path / "none")
        for form in form_names():
            assert "No accuracy" in certify(tmp_path / "none", form).report.opening

    def test_a_free_network_says_that_nothing_ties_it_to_the_ground(self, block, tmp_path):
        ground = block.ground.assign(role="check")
        block.with_(ground=ground, gnss=block.gnss.iloc[:0]).write(tmp_path / "free")
        stated = certify(tmp_path / "free", "asprs")
        assert any("free network" in doubt for doubt in stated.report.warnings)
        assert stated.report.opening.startswith("No accuracy is stated")
        assert "RMSE" not in str(stated) and "systematic" not in str(stated)

    def test_a_default_in_place_of_the_surveys_error_is_said(self, block, tmp_path):
        bare = block.with_(ground=block.ground.drop(columns=["sx", "sy", "sz"]))
        bare.write(tmp_path / "bare")
        stated = certify(tmp_path / "bare", "asprs")
        assert any("no standard deviations" in doubt for doubt in stated.report.warnings)

    @pytest.mark.parametrize("form", form_names())
    def test_what_is_required_is_compared_with_what_was_found(self, folder, adjusted, form):
        for required, word in ((0.5, "within"), (0.001, "beyond")):
            said = certify(folder, form, required=required, adjustment=adjusted).report.opening
            assert f"{word} the required" in said

    @pytest.mark.parametrize("form", form_names())
    def test_what_the_adjustment_doubts_stands_in_every_form(self, block, tmp_path, form):
        """A control point 20 cm too high, surveyed to 6 mm."""
        ground = block.ground.copy()
        ground.loc[ground.index[ground["role"].astype(str) == "control"][1], "z"] += 0.2
        block.with_(ground=ground).write(tmp_path / "wrong")
        warnings = certify(tmp_path / "wrong", form).report.warnings
        assert any("1 ground point set aside" in warning for warning in warnings)

    def test_the_full_form_says_that_points_are_too_few_for_a_class(self, block, tmp_path):
        fewer(block, 5).write(tmp_path / "few")
        assert "too few for an accuracy class" in str(certify(tmp_path / "few"))

    def test_points_in_vegetation_are_stated_apart(self, block, tmp_path):
        ground = block.ground.copy()
        ground["vegetated"] = np.where(np.arange(len(ground)) % 2, "1", "0")
        block.with_(ground=ground).write(tmp_path / "green")
        text = str(certify(tmp_path / "green", "asprs"))
        assert "VVA, vegetated" in text and "stated, not judged" in text

    def test_what_stands_in_vegetation_is_read_or_refused_by_its_row(self, adjusted):
        names = adjusted.problem.block.ground["point"]
        for words, found in ((["1.0", "0.0"], [True, False]), (["Yes", ""], [True, None])):
            cover = dict(zip(names, words * (len(names) // 2), strict=True))
            assert set(CheckPoints.of(covered(adjusted, cover)).vegetated) == set(found)
        with pytest.raises(corridor.InputError, match="row 4: vegetated = 'reeds'"):
            CheckPoints.of(covered(adjusted, {names.iloc[2]: "reeds"}))

    def test_where_all_points_are_in_vegetation_the_others_get_no_class(self, block, tmp_path):
        block.with_(ground=block.ground.assign(vegetated="1")).write(tmp_path / "reeds")
        text = str(certify(tmp_path / "reeds", "asprs"))
        assert "no class: fewer than 30 points" in text


class TestSameBytes:
    def test_a_certificate_is_verified(self, made, folder, tmp_path):
        for name, content in made["din18740"].files.items():
            (tmp_path / name).write_bytes(content)
            found = verify(tmp_path / name, folder)
            assert found.same, found

    def test_it_holds_no_path_and_no_date(self, made, folder):
        for one in made.values():
            for content in one.files.values():
                assert str(folder).encode() not in content
                assert b"CreationDate" not in content and b"ModDate" not in content

    @pytest.mark.parametrize("name", ["gnss.csv", "block.toml", "tie_points.csv"])
    def test_one_changed_byte_of_any_input_is_noticed(self, made, folder, tmp_path, name):
        changed = tmp_path / "changed"
        shutil.copytree(folder, changed)
        content = bytearray((changed / name).read_bytes())
        content[len(content) // 2] ^= 1
        (changed / name).write_bytes(bytes(content))
        paths = made["asprs"].save(tmp_path / "out")
        found = verify(paths[0], changed)
        assert not found.same and f"{name} has changed." in found.sentences

    def test_a_file_more_or_less_is_noticed(self, made, folder, tmp_path):
        paths = made["asprs"].save(tmp_path / "out")
        changed = tmp_path / "changed"
        shutil.copytree(folder, changed)
        (changed / "gnss.csv").rename(changed / "rates.csv")
        said = str(verify(paths[1], changed))
        assert "gnss.csv is missing." in said and "rates.csv is not in the certificate." in said

    @pytest.mark.parametrize("name", ["certificate.html", "certificate.pdf"])
    def test_a_certificate_that_was_changed_is_noticed(self, made, folder, tmp_path, name):
        content = made["asprs"].files[name]
        forged = content.replace(b"1", b"2", 1) if name.endswith("pdf") else content.replace(
            b"RMSE_H is", b"RMSE_H was", 1)  # fmt: skip
        assert forged != content
        (tmp_path / name).write_bytes(forged)
        assert not verify(tmp_path / name, folder).same

    @pytest.mark.parametrize(
        "spoilt",
        [
            {"files": "abc"}, {"files": ["block.toml"]}, {"figures": None}, {"software": ["numpy"]},
            {"form": ["asprs"]}, {"asked": [1]}, {"asked": {"model": {"priors": ["a"]}}},
        ],
        ids=str,
    )  # fmt: skip
    def test_a_record_of_another_shape_is_damaged(self, folder, tmp_path, spoilt):
        hashed = {"files": certifying.hashes(folder), "figures": {}, "software": {}}
        record = hashed | {"form": "asprs", "asked": {"model": {}}} | spoilt
        written = paper.embedded(json.dumps(record), certifying.MARK)
        (tmp_path / "certificate.html").write_text(written)
        with pytest.raises(corridor.InputError, match="record inside the certificate is damaged"):
            verify(tmp_path / "certificate.html", folder)

    def test_what_was_asked_is_asked_again(self, folder, tmp_path):
        model = corridor.Model(
            camera="f,cx,cy,k1", effects=["gnss_bias@flight"], lever_arm="fixed",
            priors={"gnss_bias.F1.x": (0.0, 0.05)}, loss="huber:3",
        )  # fmt: skip
        model.parameters[f"camera.{next(iter(corridor.read(folder).cameras))}.k2"].vary = False
        one = certify(folder, "asprs", model=model, required=0.1)
        paths = one.save(tmp_path)
        assert verify(paths[0], folder).same
        assert one.record["asked"]["model"]["effects"] == ["gnss_bias@flight"]


class TestCommand:
    def test_adjust_writes_it_beside_the_report_and_verify_reads_it(self, folder, tmp_path, capsys):
        out = tmp_path / "out"
        asked = ["adjust", str(folder), "-o", str(out), "--certificate", "asprs"]
        assert cli.main([*asked, "--required", "0.2"]) == 0
        assert cli.main(["verify", str(out / "certificate.pdf"), str(folder)]) == 0
        assert "Verified" in capsys.readouterr().out
        # The next result has none: the old one must not stand beside it.
        assert cli.main(["adjust", str(folder), "-o", str(out), "--camera", "f"]) == 0
        assert not (out / "certificate.pdf").exists()

    def test_a_form_that_there_is_not_and_no_folder_are_refused(self, folder, capsys):
        with pytest.raises(SystemExit) as ended:
            cli.main(["adjust", str(folder), "--certificate", "iso"])
        assert ended.value.code == 2
        assert "din18740" in capsys.readouterr().err
        assert cli.main(["adjust", str(folder), "--certificate", "full"]) == 2
        assert "-o OUT" in capsys.readouterr().err

    def test_verify_of_what_is_no_certificate_ends_with_2_and_of_another_block_with_1(
        self, made, folder, block, tmp_path, capsys
    ):
        assert cli.main(["verify", str(folder / "block.toml"), str(folder)]) == 2
        assert cli.main(["verify", str(folder), str(folder / "block.toml")]) == 2
        assert "give the certificate first" in capsys.readouterr().err
        made["asprs"].save(tmp_path)
        fewer(block, 3).write(tmp_path / "other")
        found = ["verify", str(tmp_path / "certificate.html"), str(tmp_path / "other")]
        assert cli.main(found) == 1
        assert "ground.csv has changed" in capsys.readouterr().err

    @pytest.mark.slow
    def test_check_makes_one_too(self, block, tmp_path):
        block.write(tmp_path / "block")
        out = tmp_path / "out"
        asked = ["check", str(tmp_path / "block"), "-o", str(out), "--quick"]
        assert cli.main([*asked, "--certificate", "full"]) == 0
        assert verify(out / "certificate.html", out / "block").same


def test_a_block_in_memory_has_no_files_to_name(block):
    with pytest.raises(corridor.InputError, match="write the block"):
        certify(block)


def test_long_tables_go_on_on_the_next_sheet_with_their_heading():
    from corridor.core.output import Report, Table
    from corridor.tools.certificate.paper import pdf

    rows = tuple((f"P{k}", f"{k}.5") for k in range(200))
    table = Table("Points", ("point", "error"), rows, "lr", ("a note",))
    content = pdf(Report("Many", "An opening.", tables=[table]))
    assert content.startswith(b"%PDF") and content.count(b"/Type /Page ") + content.count(
        b"/Type /Page\n") > 2  # fmt: skip
    assert content == pdf(Report("Many", "An opening.", tables=[table]))


class TestPaper:
    def test_a_bold_line_stays_within_its_room(self):
        """Bold letters are wider: a title that just fits in others ran over the margin."""
        title = "Certificate of computed accuracy, ASPRS edition 2 (2023): saraburi_full"
        for size in np.arange(11.0, 15.0, 0.5):
            lines = paper._wrapped(title, size, paper._ROOM, "bold")
            assert max(paper._width(line, size, "bold") for line in lines) <= paper._ROOM

    @pytest.mark.parametrize(("share", "sheets"), [(0.9, 1), (0.6, 2)])
    def test_a_picture_is_a_little_smaller_rather_than_alone_on_a_sheet(self, share, sheets):
        made = paper._Sheets()
        below = 8 + 3 * paper._LEAD * paper._NOTE
        made.top = paper.HIGH - paper.MARGIN - below - share * paper._PICTURE * paper.HIGH
        stream = io.BytesIO()
        Image.new("RGB", (100, 100)).save(stream, "png")
        made.picture("square", "", stream.getvalue())
        assert len(made.figures) == sheets
