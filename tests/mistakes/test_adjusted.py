"""What an adjustment says of a block in which something is wrong."""

import numpy as np
import pandas as pd
import pytest
from slips import (
    HEIGHT,
    POSE,
    QW_LAST,
    WIDTH,
    both,
    cell,
    changed,
    degrees,
    images,
    plus,
    table,
    times,
    toml,
    two_points,
)

import corridor
from corridor.interface.cli import main

# What an adjustment says: slip -> status, words of what it prints, options.
ADJUSTED = {
    "GNSS heights above the ellipsoid": (
        plus("gnss", z=43.0), 0, r"disagree by one vector \(flight F1 .*\+4[23]\.\d+ m;.*geoid", ""
    ),
    "points of half-size pictures": (
        images(lambda f: f.assign(x=f["x"] / 2, y=f["y"] / 2)), 0, "0.50 times as long", ""
    ),
    "pixels counted from the middle": (
        images(lambda f: f.assign(x=f["x"] - WIDTH / 2, y=f["y"] - HEIGHT / 2)),
        0, "are pixels counted from the middle", "",
    ),
    "two control points exchanged": (
        two_points("control", "control"), 0, "each lies where the other was surveyed", ""
    ),
    "a control and a check point exchanged": (
        two_points("control", "check"), 0, "each lies where the other was surveyed", ""
    ),
    "two control points exchanged, of images without poses": (
        both(table("images", lambda f: f.drop(columns=POSE)), two_points("control", "control")),
        0, "each lies where the other was surveyed", "",
    ),
    "a wild tie point": (cell("tie_points", 40, "x", 10), 0, "tie_points.csv, row 42", ""),
    "a wild GNSS position": (
        cell("gnss", 7, "x", 1e20), 0, r"gnss.csv, row 9: image F\S+, \de\+21 m off", ""
    ),
    "a wild height": (
        table("ground", lambda f: f.assign(z=np.where(f.index == 1, f["z"] + 800, f["z"]))),
        0, r"ground.csv, row 3: G02 \(c\w+\), \d+ m off", "",
    ),
    "a wild GNSS position, strictly": (
        cell("gnss", 7, "x", 1e20), 2, "gnss.csv, row 9.*--strict", "--strict"
    ),
    "a prior that is wrong": (
        lambda folder: None, 0, "camlight.k1 comes to .* sigmas from what is stated beforehand",
        "--prior camera.camlight.k1=0.05+-0.0005",
    ),
    "an effect that is not there": (
        lambda folder: None, 0, "does not show the effect gnss_drift", "--effect gnss_drift"
    ),
    "y upwards": (
        images(lambda f: f.assign(y=HEIGHT - 1 - f["y"])), 1, "counted upwards", "--iterations 6"
    ),
    "GNSS in degrees": (degrees("gnss"), 1, "in degrees", "--iterations 6"),
    "GNSS sigmas in millimetres": (
        changed("gnss", sx=20.0, sy=20.0, sz=40.0), 0, "20 m horizontally and 40 m in height", ""
    ),
    "GNSS sigmas a thousandth": (
        changed("gnss", sx=2e-5, sy=2e-5, sz=4e-5), 0, r"\d+ GNSS positions lie beyond 5 robust", ""
    ),
    "ground heights above the ellipsoid": (plus("ground", z=43.0), 0, "ellipsoid.*geoid", ""),
    "marks of points called otherwise": (
        changed("marks", point=lambda c: c.str.lower()), 0,
        "Control points G01, .* are not measured in any image", "",
    ),
    "one mark of another point": (
        table("marks", lambda f: f.assign(point=f["point"].where(f.index != 3, "G02"))), 0,
        "1 mark set aside, far from where all else.*: G02 in .* It lies where G01 is", "",
    ),
    "half the focal length": (toml("f = 5489.0", "f = 2744.0"), 0, "2.00 times as long", ""),
    "a calibrated focal length 2 % too long": (
        toml("f = 5489.0", "f = 5598.8\ncalibrated = true"), 0,
        r"camlight is held at 5598.8 px; estimated it comes to 5[45]\d\d.* calibration of another",
        "--lever-arm fixed",
    ),
    "width and height exchanged": (
        both(toml("width = 5120", "width = 3840"), toml("height = 3840", "height = 5120")), 0,
        "pictures turned by 90 degrees", "",
    ),
    "quaternions with qw last": (
        table("images", lambda f: f.rename(columns=QW_LAST)), 2,
        "quaternion .world to camera, qw first", "",
    ),
    "GNSS in feet": (times("gnss", 3.28084, "x", "y", "z"), 2, "gnss.csv is in feet", ""),
    "GNSS heights in millimetres": (
        times("gnss", 1000, "z"), 2, "Heights of gnss.csv are in millimetres", ""
    ),
    "GNSS of other images": (
        table("gnss", lambda f: f.assign(image=f["image"].to_numpy()[::-1])), 1,
        "did not converge", "--iterations 6",
    ),
}  # fmt: skip


# Whose adjustment is longer, or says what another row has said.
LONG = (
    "GNSS sigmas in millimetres", "GNSS sigmas a thousandth", "GNSS in feet",
    "GNSS of other images", "marks of points called otherwise", "one mark of another point",
    "half the focal length", "a wild GNSS position, strictly", "width and height exchanged",
    "two control points exchanged, of images without poses",
    "a calibrated focal length 2 % too long", "y upwards", "ground heights above the ellipsoid",
)  # fmt: skip


@pytest.mark.parametrize(
    "slip", [pytest.param(s, marks=pytest.mark.slow) if s in LONG else s for s in ADJUSTED]
)
def test_an_adjustment_says_what_is_wrong(folder, capsys, slip):
    edit, status, words, options = ADJUSTED[slip]
    edit(folder)
    assert main(["adjust", str(folder), *options.split()]) == status
    said = " ".join(" ".join(capsys.readouterr()).split())
    assert pd.Series([said]).str.contains(words)[0], said
    assert "Traceback" not in said


@pytest.mark.slow
def test_points_and_gnss_beside_images_without_poses_do_no_harm(folder):
    """Rough points, from which no image could be resected, are start values and no more."""
    table("images", lambda f: f.drop(columns=POSE))(folder)
    found = corridor.adjust(folder)
    assert found.converged and found.sigma0 < 1.2
