"""The picture of a track: legible, and true to what was refused."""

import numpy as np
import pandas as pd
import pytest
from test_pictures import assert_legible, written

from corridor.interface import figures


def made(round_flight=False, sigmas=True, refused=3, exposures=40):
    time = np.linspace(1000, 1400, 801)
    turn = (time - 1000) / 400 * 2 * np.pi
    x, y = (
        (100 * np.cos(turn), 100 * np.sin(turn)) if round_flight else (time * 2, 5 * np.sin(turn))
    )
    positions = pd.DataFrame({"time_s": time, "x": x, "y": y})
    curve = pd.DataFrame({"time_s": time, "segment": 0})
    sigma = 0.01 + 0.2 * np.exp(-(((time - 1200) / 5) ** 2))
    for name, factor in (("sx", 1.0), ("sy", 1.1), ("sz", 1.6)):
        curve[name] = sigma * factor if sigmas else np.nan
    shown = positions.iloc[np.linspace(20, 780, exposures).astype(int)].reset_index(drop=True)
    shown[["sx", "sy", "sz"]] = curve.iloc[np.linspace(20, 780, exposures).astype(int)][
        ["sx", "sy", "sz"]
    ].to_numpy()
    shown["why"] = ""
    shown.loc[shown.index[:refused], "why"] = "sigma 0.20 m is above 0.1 m"
    return positions, shown, curve


CASES = {
    "corridor": made(),
    "round": made(round_flight=True),
    "no sigmas": made(sigmas=False),
    "nothing refused": made(refused=0),
    "all refused": made(refused=40),
    "one exposure": made(refused=0, exposures=1),
}


@pytest.mark.parametrize("case", CASES)
def test_no_text_covers_another_or_leaves_the_sheet(case):
    assert_legible(figures.track(*CASES[case], 0.1, "a track", "method: smoother"))


def test_the_keys_count_the_exposures_and_axes_have_units():
    texts = [text for text, _ in written(figures.track(*CASES["corridor"], 0.1, "a track"))]
    assert "37 exposures, good" in texts and "3 exposures, refused" in texts
    assert "sigma (mm)" in texts and "along the block (m)" in texts
    assert any(text.startswith("time since 00:1") and text.endswith("(min)") for text in texts)
    assert "refused above 100 mm" in texts


def test_a_track_without_epochs_says_so():
    positions, shown, curve = CASES["corridor"]
    figure = figures.track(positions.iloc[:0], shown.iloc[:0], curve.iloc[:0])
    assert any("no epochs" in text for text, _ in written(figure))


def test_the_dots_stand_at_the_largest_sigma_in_millimetres():
    positions, shown, curve = CASES["nothing refused"]
    figure = figures.track(positions, shown, curve, 0.1)
    along = figure.axes[-1]
    dots = [line for line in along.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert dots[0].get_ydata() == pytest.approx(1000 * shown["sz"].to_numpy())
