"""What is probably a mistake in a block is said at first sight, without an adjustment."""

import numpy as np
import pandas as pd
import pytest
from slips import (
    HEIGHT,
    WIDTH,
    both,
    cell,
    changed,
    degrees,
    exchanged,
    images,
    more,
    plus,
    reversed_track,
    table,
    times,
    toml,
)

import corridor
from corridor.core.preparation import AXES, plausibility_warnings, position_difference


def distance(factor):
    """A distance between two points of ground.csv, too long by a factor."""

    def edit(folder):
        ground = pd.read_csv(folder / "ground.csv")
        one, other = ground[["x", "y", "z"]].to_numpy(float)[:2]
        name, end = ground["point"][:2]
        length = factor * np.linalg.norm(one - other)
        (folder / "distances.csv").write_text(f"from,to,distance\n{name},{end},{length:.4f}\n")

    return edit


def twice(folder):
    """The second image is there again, as `copy.tif`."""

    def again(rows):
        second = rows[rows["image"] == rows["image"].unique()[1]]
        return pd.concat([rows, second.assign(image="copy.tif")])

    for name in ("images", "tie_points"):
        table(name, again)(folder)


# Seen at first sight, without an adjustment: slip -> words of the sentence.
AT_FIRST_SIGHT = {
    "picture half as large": (
        both(toml("width = 5120", "width = 2560"), toml("height = 3840", "height = 1920")),
        "lie outside its picture of 2560 x 1920 px: are width and height",
    ),
    "picture twice as large": (
        both(toml("width = 5120", "width = 10240"), toml("height = 3840", "height = 7680")),
        "No observation.*beyond x = .* of its picture of 10240 x 7680",
    ),
    "points of half-size pictures": (
        images(lambda f: f.assign(x=f["x"] / 2, y=f["y"] / 2)),
        "points measured on reduced pictures",
    ),
    "pixels counted from the middle": (
        images(lambda f: f.assign(x=f["x"] - WIDTH / 2, y=f["y"] - HEIGHT / 2)),
        "counted from the middle of the picture",
    ),
    "y upwards": (images(lambda f: f.assign(y=HEIGHT - 1 - f["y"])), "is y counted upwards"),
    "x and y of image points exchanged": (
        images(lambda f: f.rename(columns={"x": "y", "y": "x"})),
        "fit the start poses with x and y exchanged",
    ),
    "quaternions with qw last": (
        table(
            "images",
            lambda f: f.assign(qw=f["qx"], qx=f["qy"], qy=f["qz"], qz=f["qw"]),
        ),
        "fit the start poses if qw is the last of the four",
    ),
    "marks counted from the middle, y upwards": (
        table("marks", lambda f: f.assign(x=f["x"] - WIDTH / 2, y=HEIGHT / 2 - f["y"])),
        "Marks lie .* as if they were counted from the middle, y upwards",
    ),
    "marks counted from the middle": (
        table("marks", lambda f: f.assign(x=f["x"] - WIDTH / 2, y=f["y"] - HEIGHT / 2)),
        "Marks lie .* as if they were counted from the middle:",
    ),
    "GNSS in feet": (times("gnss", 1 / 0.3048, "x", "y", "z"), "gnss.csv is in feet"),
    "poses in kilometres": (times("images", 1e-3, "x", "y", "z"), "images.csv is in kilometres"),
    "GNSS from the last image to the first": (
        table("gnss", lambda f: f.assign(image=f["image"].to_numpy()[::-1])),
        "from the last to the first: read so, they lie 0",
    ),
    "a lever arm in millimetres": (
        more("[lever_arm]\ndefault = [10.0, 20.0, 120.0]"),
        r"lever arm of default is 122\.1 m long; what flies",
    ),
    "one tie point outside": (
        cell("tie_points", 40, "x", 10),
        r"1 observation outside the picture .* tie_points.csv, row 42: point T\d+ in image F",
    ),
    "a picture under two names": (
        twice,
        r"2 images .*copy.tif\) have their points",
    ),
    "focal length in millimetres": (toml("f = 5489.0", "f = 35.1"), "f is in pixels"),
    "GNSS heights above the ellipsoid": (plus("gnss", z=43.0), "ellipsoid.*geoid"),
    "GNSS in degrees": (degrees("gnss"), "gnss.csv gives x and y in degrees"),
    "GNSS with x and y exchanged": (exchanged("gnss"), "gnss.csv has x and y exchanged"),
    "GNSS without the offset": (plus("gnss", x=5e5, y=5.7e6), "5,722 km.*subtract the block's"),
    "ground in degrees": (degrees("ground"), "ground.csv is in degrees"),
    "ground with x and y exchanged": (exchanged("ground"), "ground.csv has x and y exchanged"),
    "ground of another place": (plus("ground", x=7e3), "ground.csv lies 7.0. km from"),
    "velocities in km/h": (times("images", 3.6, "vx", "vy", "vz"), r"3\.\d+ times .*km/h"),
    "velocities in knots": (times("images", 1.944, "vx", "vy", "vz"), "knots"),
    "velocities of the other sign": (
        times("images", -1.0, "vx", "vy", "vz"),
        r"point against the way .* in 12 of 12 pairs",
    ),
    "times in the opposite order": (
        changed("images", time_s=lambda c: c.to_numpy()[::-1]),
        "time_s falls .*opposite order",
    ),
    "times of the other sign": (times("images", -1.0, "time_s"), "time_s falls .*opposite order"),
    "a track in the opposite order": (
        reversed_track,
        "track.csv: time_s falls from row to row in all 30",
    ),
    "times in milliseconds": (times("images", 1e3, "time_s"), "is time_s in milliseconds"),
    "temperatures in kelvin": (
        changed("images", temperature_c=lambda c: 293.0 + np.arange(len(c))),
        "temperature_c is 3?[0-9]+ .* kelvin",
    ),
    "a distance in feet": (distance(1 / 0.3048), "distances.csv, row 2: .* 3.28 times .* feet"),
    "a distance of other points": (distance(1.6), "1.6 times .* are the names right"),
    "a readout in milliseconds": (more("readout_s = 30"), "readout_s = 30 .* 30 ms are 0.03"),
    "readout for readout_s": (more("readout = 0.03"), "did you mean readout_s"),
    "[sigmas] for [sigma]": (more("[sigmas]\ntie_px = 1.0"), r"\[sigmas\].*did you mean sigma"),
    "[lever_arms]": (more("[lever_arms]\ndefault = [0, 0, 0]"), "did you mean lever_arm"),
    "offsets for offset": (more("offsets = [0, 0, 0]", first=True), "did you mean offset"),
    "a file called otherwise": (
        lambda folder: (folder / "gnss.csv").rename(folder / "Gnss.CSV"),
        r"Gnss.CSV is not read: a block has gnss.csv",
    ),
    "a table of another kind": (
        lambda folder: (folder / "ground.csv").rename(folder / "ground.xlsx"),
        r"ground.xlsx is not read: a block has ground.csv",
    ),
    "a name in one word": (
        lambda folder: (folder / "tie_points.csv").rename(folder / "tiepoints.csv"),
        r"tiepoints.csv is not read: a block has tie_points.csv",
    ),
    "a crs that is none": (more('crs = "UTM32"', first=True), "is not a coordinate system"),
    "a crs in degrees": (more('crs = "EPSG:4326"', first=True), "counts degrees"),
    "a geocentric crs": (more('crs = "EPSG:4978"', first=True), "has no height axis"),
}


@pytest.mark.parametrize("slip", AT_FIRST_SIGHT)
def test_is_seen_at_first_sight(folder, slip):
    edit, words = AT_FIRST_SIGHT[slip]
    edit(folder)
    told = plausibility_warnings(corridor.read(folder))
    assert any(pd.Series([told_one]).str.contains(words)[0] for told_one in told), told
    # Nothing else is suspected, but for what follows from it.
    assert len(told) <= 2


def test_of_a_sound_block_nothing_is_suspected(sound):
    assert plausibility_warnings(corridor.read(sound)) == []


class TestPositionsBesidePoses:
    """What `corridor gnss` says where images.csv has poses, and a block beside its gnss.csv."""

    poses = np.random.default_rng(1).uniform([0, 0, 40], [200, 60, 60], (30, 3))

    def told(self, given):
        return position_difference("the track", given, "images.csv", self.poses)

    def test_what_agrees_is_not_told(self):
        assert self.told(self.poses + 0.5) == ""

    @pytest.mark.parametrize(("metres", "unit"), [(0.3048, "feet"), (0.01, "centimetres")])
    def test_heights_alone_in_another_unit_are_told(self, metres, unit):
        given = self.poses / [1.0, 1.0, metres]
        assert f"times those of images.csv: are they in {unit}?" in self.told(given)
        assert "geoid" in self.told(self.poses + [0.0, 0.0, 45.0])

    @pytest.mark.parametrize(("words", "order", "sign"), AXES)
    def test_other_axes_are_told(self, words, order, sign):
        assert f"has {words} beside images.csv" in self.told((self.poses * sign)[:, order])

    def test_x_and_y_exchanged_along_a_diagonal_are_told(self):
        """They lie within 15 m of a strip of 75 m, and went into the standard deviations."""
        along = np.linspace(0.0, 60.0, 12)
        poses = np.column_stack([along, 0.4 * along + 20.0, np.full(12, 260.0)])
        told = position_difference("gnss.csv", poses[:, [1, 0, 2]] + 0.3, "images.csv", poses)
        assert "x and y exchanged" in told

    def test_poses_of_a_frame_of_their_own_say_nothing(self):
        turned = self.poses @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]) * 0.3
        assert self.told(turned + [5e5, 5e6, 100.0]) in (
            "", self.told(self.poses + [5e5, 5e6, 0.0])
        ) or "offset" in self.told(turned + [5e5, 5e6, 100.0])  # fmt: skip

    def test_one_wild_position_among_thirty_is_no_matter_of_the_frame(self):
        given = self.poses + 0.1
        given[3] *= 100.0
        assert self.told(given) == ""

    def test_unknown_ones_do_not_count(self):
        given = self.poses + [0.0, 0.0, 43.0]
        given[::2] = np.nan
        assert "geoid" in self.told(given)
