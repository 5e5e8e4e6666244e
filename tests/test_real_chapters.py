"""Numbers that chapters print of real data are those that the package finds, where the data are."""

import json
import re
from pathlib import Path

import pytest
from kit.real import slow_ones, special_plot, without_images

import corridor

NOTEBOOKS = Path(__file__).resolve().parents[1] / "notebooks"


def stored(chapter, words):
    """Value and sigma of the line `NAME value +- sigma UNIT  words` of an executed chapter."""
    notebook = json.loads((NOTEBOOKS / f"{chapter}.ipynb").read_text(encoding="utf-8"))
    text = "".join(
        "".join(output.get("text", []))
        for cell in notebook["cells"]
        for output in cell.get("outputs", [])
    )
    value, sigma = re.search(
        rf"(-?[\d.]+) \+- ([\d.]+) \w+  {re.escape(words)}$", text, re.M
    ).groups()
    return float(value), float(sigma)


@pytest.mark.slow
@pytest.mark.parametrize("all_of_them", [True, False])
def test_the_readout_of_the_phantom_is_the_one_that_chapter_5_shows(real_data, all_of_them):
    flight = special_plot(real_data)
    slow = slow_ones(flight, 2.0)
    assert slow.sum() == 9
    words = "all" if all_of_them else "without 9 slow ones"
    found = corridor.adjust(
        flight if all_of_them else without_images(flight, slow),
        camera="fraser8", lever_arm="fixed", loss="huber:2", effects=["rolling_shutter"],
    ).effects.iloc[0]  # fmt: skip
    value, sigma = stored("05_missing_effect", words)
    # Printed to a tenth of a millisecond; optima of a robust loss are found to a tenth of a sigma.
    assert 1000 * found["value"] == pytest.approx(value, abs=0.05 + 0.1 * sigma)
    assert 1000 * found["sigma"] == pytest.approx(sigma, abs=0.05 + 0.1 * sigma)


@pytest.mark.slow
def test_the_focal_length_of_the_phantom_is_the_one_that_chapter_5_shows(real_data):
    found = corridor.adjust(
        special_plot(real_data), camera="fraser8", lever_arm="fixed", loss="huber:2",
        effects=["rolling_shutter", "clock_offset"],
    ).camera.set_index("parameter").loc["f"]  # fmt: skip
    value, sigma = stored("05_missing_effect", "with shutter and clock")
    assert found["value"] == pytest.approx(value, abs=0.5 + 0.1 * sigma)
