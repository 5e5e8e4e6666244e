"""The register of published numbers, the verdicts on ours, and the page that lists them."""

import json
import re

import numpy as np
import pytest
from kit import published

from corridor.core.errors import InputError

REGISTER = """
[alpha]
source = "A. Author 2020"
where = "table 2"
chapter = "00_quickstart"
kind = "prediction"

[alpha.height]
row = "height"
value = 0.040
unit = "m"
tolerance = 0.002
note = "their scale is another"

[alpha.shift]
row = "shift"
value = [1.0, -2.0, 3.5]
unit = "px"
tolerance = "1 %"
"""


@pytest.fixture
def register(tmp_path):
    return published.read(_written(tmp_path, REGISTER))


def _written(folder, text):
    path = folder / "published.toml"
    path.write_text(text, encoding="utf-8")
    return path


class TestRegister:
    def test_entries_inherit_what_stands_above_them(self, register):
        entry = register["alpha.height"]
        assert (entry.source, entry.where, entry.chapter) == (
            "A. Author 2020",
            "table 2",
            "00_quickstart",
        )

    def test_printed_digits_are_kept(self, register):
        """0.040 says more than 0.04."""
        entry = register["alpha.height"]
        assert entry.text(entry.values) == "0.040 m"

    def test_numbers_that_belong_together_are_an_array(self, register):
        np.testing.assert_array_equal(register["alpha.shift"].value, [1.0, -2.0, 3.5])

    def test_a_percentage_is_a_share_of_each_value(self, register):
        np.testing.assert_allclose(register["alpha.shift"].allowed, [0.01, 0.02, 0.035])

    @pytest.mark.parametrize(
        ("old", "new", "named"),
        [
            ('row = "height"\n', "", "lacks row"),
            ('kind = "prediction"\n', "", "lacks kind"),
            ('kind = "prediction"', 'kind = "guess"', "kind one of"),
            ('unit = "m"', 'unit = "m"\nunits = "m"', "unknown units"),
            ("value = 0.040", 'value = "small"', "value is a number"),
            ("tolerance = 0.002", "tolerance = [0.002, 0.1]", "one of these a value"),
            ('tolerance = "1 %"', 'tolerance = "1 px"', "tolerance a number"),
            ('unit = "m"', 'unit = "m"\nbound = "about"', "bound"),
        ],
    )
    def test_a_wrong_entry_is_named(self, tmp_path, old, new, named):
        assert old in REGISTER
        path = _written(tmp_path, REGISTER.replace(old, new))
        with pytest.raises(InputError, match=named) as error:
            published.read(path)
        assert "[alpha." in str(error.value)

    def test_numbers_that_belong_together_may_have_a_tolerance_each(self, tmp_path):
        text = REGISTER.replace('tolerance = "1 %"', 'tolerance = ["1 %", 0.3, "2 %"]')
        allowed = published.read(_written(tmp_path, text))["alpha.shift"].allowed
        np.testing.assert_allclose(allowed, [0.01, 0.3, 0.07])

    def test_a_missing_register_is_wrong_input(self, tmp_path):
        with pytest.raises(InputError, match=r"nowhere\.toml"):
            published.read(tmp_path / "nowhere.toml")


class TestProjectRegister:
    """The one in notebooks/: read whole, as every chapter reads it."""

    def test_it_holds_the_published_adjustment_of_strasbourg(self):
        """DBAT, data/script/sxb/result/report.txt: sigma0 1.1786, redundancy 1261."""
        register = published.read()
        assert register["strasbourg.sigma0"].value == 1.1786
        assert register["strasbourg.redundancy"].value == 1261

    def test_every_tolerance_is_wide_enough_for_the_rounding_of_the_print(self):
        """A number printed with d decimals is known to half a unit of the last one."""
        for entry in published.read().values():
            half = 0.0 if entry.digits == 0 else 0.5 * 10.0**-entry.digits
            assert np.all(entry.allowed >= half), entry.id

    def test_it_agrees_with_the_data_it_is_about(self, real_data):
        """Two independent copies of the same printed figures must not drift apart."""
        register = published.read()
        expected = json.loads((real_data / "strasbourg" / "expected.json").read_text("utf-8"))
        theirs = expected["published"]
        photo = theirs["photos"]["8811.jpg"]
        pairs = {
            "strasbourg.sigma0": theirs["sigma0"],
            "strasbourg.redundancy": theirs["redundancy"],
            "strasbourg.residual_norm": theirs["last_error"],
            "strasbourg.image_rms": theirs["image_rms_px"],
            "strasbourg.largest_residual": theirs["max_residual_px"],
            "strasbourg.check_largest": [theirs["check_max_abs_difference_m"][a] for a in "xyz"],
            "strasbourg.check_rms_3d": theirs["check_rms_3d_m"],
            "strasbourg.check_351.difference": theirs["check"]["351"]["difference_m"],
            "strasbourg.check_410.difference": theirs["check"]["410"]["difference_m"],
            "strasbourg.check_351.sigma": theirs["check"]["351"]["sigma_m"],
            "strasbourg.check_410.sigma": theirs["check"]["410"]["sigma_m"],
            "strasbourg.control_largest": [theirs["control_max_difference_m"][a] for a in "xyz"],
            "strasbourg.control_rms_3d": theirs["control_rms_3d_m"],
            "strasbourg.photo_1.angles": [photo[f"{a}_deg"] for a in ("omega", "phi", "kappa")],
            "strasbourg.photo_1.angle_sigma": [
                photo["sigma"][f"{a}_deg"] for a in ("omega", "phi", "kappa")
            ],
            "strasbourg.photo_1.position": [photo[a] for a in "xyz"],
            "strasbourg.photo_1.position_sigma": [photo["sigma"][a] for a in "xyz"],
            "strasbourg.photo_1.correlation": [
                photo["correlation"]["omega_y"],
                photo["correlation"]["phi_x"],
            ],
        }
        assert set(pairs) == {name for name in register if name.startswith("strasbourg.")}
        for name, value in pairs.items():
            np.testing.assert_array_equal(register[name].value, value, err_msg=name)


class TestVerdicts:
    def test_within_the_tolerance_it_holds(self, register):
        verdicts = published.compare({"alpha.height": 0.0419}, register=register)
        assert verdicts["alpha.height"].word == "holds"
        assert verdicts.hold

    def test_on_the_tolerance_it_holds(self, register):
        """0.042 - 0.040 is a little more than 0.002 in binary."""
        assert 0.042 - 0.040 > 0.002
        assert published.compare({"alpha.height": 0.042}, register=register).hold

    def test_beyond_it_the_row_shows_the_ratio_and_the_registered_reason(self, register):
        verdict = published.compare({"alpha.height": 0.0441}, register=register)["alpha.height"]
        assert verdict.word == "does not hold"
        assert verdict.cells()["ours / published"] == "1.10"
        assert verdict.why == "their scale is another"

    def test_by_draws_a_published_value_holds_within_their_range(self, tmp_path):
        """0.040 is printed to 0.0005, so that draws from 0.0404 reach it and from 0.0406 do not."""
        text = REGISTER.replace("tolerance = 0.002", 'tolerance = "draws"')
        register = published.read(_written(tmp_path, text))
        for lowest, holds in ((0.0404, True), (0.0406, False)):
            draws = published.Draws(np.array([0.060, lowest, 0.051]))
            assert published.compare({"alpha.height": draws}, register=register).hold == holds

    def test_one_of_three_numbers_off_is_enough(self, register):
        good = published.compare({"alpha.shift": [1.009, -2.0, 3.5]}, register=register)
        bad = published.compare({"alpha.shift": [1.011, -2.0, 3.5]}, register=register)
        assert good.hold and not bad.hold

    @pytest.mark.parametrize("value", [None, float("nan")])
    def test_what_was_not_measured_cannot_be_told(self, register, value):
        verdicts = published.compare({"alpha.height": value}, absent="no data", register=register)
        assert verdicts["alpha.height"].word == "cannot tell"
        assert verdicts["alpha.height"].why == "no data"
        assert not verdicts.hold

    def test_judged_on_all_digits_shown_rounded(self, register):
        """0.0379996 is off by 0.0020004: shown like 0.038, but it does not hold."""
        verdict = published.compare({"alpha.height": 0.0379996}, register=register)["alpha.height"]
        assert verdict.cells()["ours"] == "0.038 m"
        assert verdict.word == "does not hold"

    @pytest.mark.parametrize(
        ("bound", "ours", "word"),
        [
            ("at most", -7.0, "holds"),
            ("at most", 0.0419, "holds"),
            ("at most", 0.0421, "does not hold"),
            ("at least", 7.0, "holds"),
            ("at least", 0.0379, "does not hold"),
        ],
    )
    def test_a_bound_holds_on_its_side_and_within_the_tolerance(self, tmp_path, bound, ours, word):
        text = REGISTER.replace("tolerance = 0.002", f'tolerance = 0.002\nbound = "{bound}"')
        register = published.read(_written(tmp_path, text))
        verdict = published.compare({"alpha.height": ours}, register=register)["alpha.height"]
        assert verdict.word == word
        assert verdict.cells()["published"] == f"{bound} 0.040 m"

    def test_draws_are_judged_by_their_median_and_shown_with_their_range(self, register):
        """Median of 0.030, 0.041, 0.060 is 0.041, within 0.002 of 0.040; their mean is not."""
        draws = published.Draws(np.array([0.060, 0.030, 0.041]))
        verdict = published.compare({"alpha.height": draws}, register=register)["alpha.height"]
        assert verdict.word == "holds"
        assert verdict.cells()["ours"] == "0.041 (0.030 to 0.060) m"

    def test_draws_of_three_numbers_have_three_ranges(self, register):
        draws = published.Draws(np.array([[1.0, -2.0, 3.5], [1.0, -2.0, 3.4], [1.0, -2.1, 3.6]]))
        verdict = published.compare({"alpha.shift": draws}, register=register)["alpha.shift"]
        assert verdict.word == "holds"
        assert "3.5 (3.4 to 3.6) px" in verdict.cells()["ours"]

    def test_an_id_without_entry_is_wrong_input(self, register):
        with pytest.raises(InputError, match=r"alpha\.depth"):
            published.compare({"alpha.depth": 1.0}, register=register)

    def test_a_wrong_count_of_numbers_is_wrong_input(self, register):
        with pytest.raises(InputError, match=r"alpha\.shift"):
            published.compare({"alpha.shift": [1.0, 2.0]}, register=register)

    def test_text_html_and_table_show_the_same(self, register):
        verdicts = published.compare(
            {"alpha.height": 0.041, "alpha.shift": None}, register=register
        )
        cells = verdicts.table.iloc[0].to_dict()
        assert cells["published"] == "0.040 m" and cells["ours"] == "0.041 m"
        html, text = verdicts._repr_html_(), str(verdicts)
        for word in cells.values():
            assert word in text and word in html
        assert text.endswith("1 of 1 predictions hold; 1 cannot be told.")

    def test_what_was_put_in_or_tuned_is_not_counted_as_a_prediction(self, tmp_path):
        text = REGISTER.replace('row = "shift"', 'row = "shift"\nkind = "tuned"')
        register = published.read(_written(tmp_path, text))
        verdicts = published.compare(
            {"alpha.height": 0.01, "alpha.shift": [1.0, -2.0, 3.5]}, register=register
        )
        assert str(verdicts).endswith("0 of 1 predictions hold. Not counted: 1 of 1 tuned.")

    def test_of_a_long_table_the_rows_that_hold_are_folded(self, register):
        good = published.compare({"alpha.height": 0.041}, register=register)
        bad = published.compare({"alpha.height": 0.05}, register=register)
        long = sum([good] * 12, bad)._repr_html_()
        assert "12 rows hold" in long
        assert long.index("does not hold") < long.index("<details>")

    def test_a_row_that_fails_says_with_which_change_it_holds_or_how_near_one_comes(self, register):
        def table(height, shift):
            return published.compare(
                {"alpha.height": height, "alpha.shift": shift}, register=register
            )

        wrong, right = [1.0, -2.0, 9.0], [1.0, -2.0, 3.5]
        changed = {"wind": table(0.05, right), "rain": table(0.044, wrong)}
        assert published.reasons(
            table(0.05, wrong), changed, "(there)", "two kinds of weather"
        ) == {
            "alpha.height": "holds with none of two kinds of weather; nearest with rain: 0.044 m",
            "alpha.shift": "holds with wind (there)",
        }

    def test_a_table_says_nothing_of_time_or_memory(self, register):
        """Notebook outputs are compared word by word."""
        verdicts = published.compare({"alpha.height": 0.041}, register=register)
        assert not re.search(r"0x[0-9a-f]{6}", verdicts._repr_html_() + repr(verdicts))


class TestPage:
    def test_it_lists_what_the_executed_notebooks_show(self, tmp_path, register):
        verdicts = published.compare(
            {"alpha.height": 0.041, "alpha.shift": [0, 0, 0]}, register=register
        )
        _notebook(tmp_path / "05_thing.ipynb", verdicts._repr_mimebundle_())
        _notebook(tmp_path / "06_other.ipynb", {"text/plain": "nothing to compare"})
        text = published.page(tmp_path)
        assert "[05_thing](05_thing.ipynb)" in text and "06_other" not in text
        row = "| height | A. Author 2020, table 2 | prediction | 0.040 m | 0.041 m | 1.02 | holds |"
        assert f"{row}  |" in text.splitlines()
        # An author of whom the project's register knows nothing: a check of the software.
        assert f"| {published.GROUPS['programs']} | 1 | 1 | 0 |" in text.splitlines()

    def test_its_headline_counts_the_works_alone(self):
        """A check of the software that holds is no confirmation of a work that is done again."""
        text = published.page()
        (headline,) = re.findall(r"\*\*(\d+) of (\d+) predictions of the thesis", text)
        row = next(x for x in text.splitlines() if x.startswith("| the thesis and its articles"))
        hold, fail, _ = (int(x) for x in re.findall(r"\d+", row))
        assert (hold, hold + fail) == tuple(map(int, headline))

    def test_a_reason_that_many_rows_share_stands_once(self, tmp_path):
        register = published.read(
            _written(
                tmp_path,
                REGISTER.replace('row = "shift"', 'row = "shift"\nnote = "their scale is another"'),
            )
        )
        verdicts = published.compare(
            {"alpha.height": 1.0, "alpha.shift": [9, 9, 9]}, register=register
        )
        for text in (str(verdicts), verdicts._repr_html_()):
            assert text.count("their scale is another") == 1 and text.count("note 1") == 3

    def test_no_row_that_does_not_hold_lacks_a_reason(self):
        rows = [
            row for path in published.NOTEBOOKS.glob("*.ipynb") for row in published._shown(path)
        ]
        assert rows
        assert not [
            row["statement"]
            for row in rows
            if row["verdict"] == published.FAILS and not row["why"].strip()
        ]

    def test_the_committed_page_is_current(self):
        """If this fails: python -m kit.published"""
        committed = (published.NOTEBOOKS / "verdicts.md").read_text(encoding="utf-8")
        assert committed == published.page()


def _notebook(path, data):
    cell = {"cell_type": "code", "outputs": [{"output_type": "display_data", "data": data}]}
    path.write_text(json.dumps({"cells": [{"cell_type": "markdown"}, cell]}), encoding="utf-8")
