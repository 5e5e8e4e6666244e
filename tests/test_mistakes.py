"""What people type and save by mistake: each ends in one sentence that says where, and why.

The short form of some 320 mistakes that were tried. Faults of single cells and files, which are
refused when a block is read, stand in test_block_bad_input.py, those of plans in
simulation/test_bad_plans.py, of tracks in gnss/, of photographs in readout/.
"""

import shutil

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.cli import main
from corridor.preparation import against, doubts
from corridor.simulation import add_noise

WIDTH, HEIGHT, FOCAL = 5120, 3840, 5489.0


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A small block in which nothing is wrong."""
    block = corridor_block(
        images=15, strips=3, flights=2, observations_per_image=60, control=5, check=2, seed=4,
        azimuth_deg=60.0, start_error=(0.3, 0.004, 0.5),
    )  # fmt: skip
    block.lever_arm = {}
    path = tmp_path_factory.mktemp("sound") / "dike"
    noise = dict(tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01)
    add_noise(block, **noise, seed=4).write(path)
    return path


@pytest.fixture
def folder(sound, tmp_path):
    return shutil.copytree(sound, tmp_path / "dike")


# --- slips of the hand ------------------------------------------------------------------------


def table(name, change):
    """A table changed: `change` returns another one, or changes it in place."""

    def edit(folder):
        frame = pd.read_csv(folder / f"{name}.csv")
        changed = change(frame)
        (frame if changed is None else changed).to_csv(folder / f"{name}.csv", index=False)

    return edit


def plus(name, **shifts):
    """Columns of a table shifted."""
    return table(name, lambda frame: frame.assign(**{k: frame[k] + v for k, v in shifts.items()}))


def times(name, factor, *columns):
    """Columns of a table multiplied."""
    return table(name, lambda frame: frame.assign(**{k: frame[k] * factor for k in columns}))


def cell(name, row, column, factor):
    """One cell multiplied."""

    def change(frame):
        frame.loc[row, column] *= factor

    return table(name, change)


def exchanged(name, one="x", other="y"):
    """Two columns exchanged."""
    return table(name, lambda frame: frame.rename(columns={one: other, other: one}))


def degrees(name):
    """Plan positions in degrees, about 51 N 7 E."""
    return table(
        name, lambda frame: frame.assign(x=7 + frame["x"] / 70_000, y=51 + frame["y"] / 111_000)
    )


def toml(old, new):
    """A text in block.toml replaced."""

    def edit(folder):
        text = (folder / "block.toml").read_text()
        assert old in text
        (folder / "block.toml").write_text(text.replace(old, new, 1))

    return edit


def more(text, first=False):
    """Text at the end of block.toml, in the table of the camera, or at its head."""

    def edit(folder):
        path = folder / "block.toml"
        parts = (text, path.read_text()) if first else (path.read_text(), text)
        path.write_text("\n".join(parts))

    return edit


def both(*edits):
    def edit(folder):
        for one in edits:
            one(folder)

    return edit


def images(change):
    """Image coordinates of ties and marks changed alike."""
    return both(table("tie_points", change), table("marks", change))


def changed(name, **columns):
    """Columns of a table replaced: by values, or by what a function makes of the old ones."""
    return table(
        name,
        lambda f: f.assign(**{k: v(f[k]) if callable(v) else v for k, v in columns.items()}),
    )


def two_points(frame):
    """Control points exchanged."""
    control = frame.index[frame["role"] == "control"][[1, 3]]
    xyz = frame.loc[control, ["x", "y", "z"]].to_numpy()
    frame.loc[control, ["x", "y", "z"]] = xyz[::-1]


POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
QW_LAST = {"qw": "qx", "qx": "qy", "qy": "qz", "qz": "qw"}

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
    "one tie point outside": (
        cell("tie_points", 40, "x", 10),
        r"1 observation outside the picture .* tie_points.csv, row 42: point T\d+ in image F",
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
    "times in milliseconds": (times("images", 1e3, "time_s"), "is time_s in seconds"),
    "a readout in milliseconds": (more("readout_s = 30"), "readout_s = 30 .* 30 ms are 0.03"),
    "readout for readout_s": (more("readout = 0.03"), "did you mean readout_s"),
    "[sigmas] for [sigma]": (more("[sigmas]\ntie_px = 1.0"), r"\[sigmas\].*did you mean sigma"),
    "[lever_arms]": (more("[lever_arms]\ndefault = [0, 0, 0]"), "did you mean lever_arm"),
    "offsets for offset": (more("offsets = [0, 0, 0]", first=True), "did you mean offset"),
    "a crs that is none": (more('crs = "UTM32"', first=True), "is no coordinate system"),
    "a crs in degrees": (more('crs = "EPSG:4326"', first=True), "counts degrees"),
    "a geocentric crs": (more('crs = "EPSG:4978"', first=True), "has no height axis"),
}


@pytest.mark.parametrize("slip", AT_FIRST_SIGHT)
def test_is_seen_at_first_sight(folder, slip):
    edit, words = AT_FIRST_SIGHT[slip]
    edit(folder)
    told = doubts(corridor.read(folder))
    assert any(pd.Series([told_one]).str.contains(words)[0] for told_one in told), told
    # Nothing else is suspected, but for what follows from it.
    assert len(told) <= 2


def test_of_a_sound_block_nothing_is_suspected(sound):
    assert doubts(corridor.read(sound)) == []


# Refused when the block is read: slip -> words of the sentence.
REFUSED = {
    "control without a standard deviation": (changed("ground", sx=0.0), "row 2: sx = 0 is not a"),
    "a role in capitals": (
        changed("ground", role=lambda c: c.str.capitalize()), "role 'Control' is unknown"
    ),
    "a role of another program": (changed("ground", role="gcp"), "write one of control, check"),
    "names with blanks": (changed("ground", point=lambda c: c + " "), "has blanks around it"),
    "image names without suffix": (
        changed("gnss", image=lambda c: c.str.replace(".tif", "")), "image 'F1_0001' is not in"
    ),
    "image names in capitals": (
        changed("tie_points", image=lambda c: c.str.upper()), "'F1_0001.TIF' is not in images.csv"
    ),
    "image names with their folder": (
        changed("marks", image=lambda c: "DCIM/" + c), "marks.csv, row 2: image 'DCIM/"
    ),
    "a position of no image": (
        table("gnss", lambda f: pd.concat([f, f[:1].assign(image="nope.tif")])),
        "gnss.csv, row 17: image 'nope.tif' is not in images.csv",
    ),
    "an observation twice": (
        table("tie_points", lambda f: pd.concat([f, f[:5]])), "row 896: .* stands already"
    ),
    "an image twice": (table("images", lambda f: pd.concat([f, f[:1]])), "row 17: image .* stands"),
    "a point marked twice": (table("marks", lambda f: pd.concat([f, f[:1]])), "stands already"),
    "quaternions of length 1.2": (times("images", 1.2, "qw", "qx", "qy", "qz"), "quaternion"),
    "times that stand still": (changed("images", time_s=5.0), "time_s = 5 stands still"),
    "times of the day": (changed("images", time_s="12:00:01"), "'12:00:01' is not a number"),
    "a camera of no table": (changed("images", camera="other"), "camera 'other' is not in"),
    "a position without height": (
        changed("gnss", z=lambda c: c.where(c.index != 2)), "gnss.csv, row 4: z is empty"
    ),
    "a negative focal length": (toml("f = 5489.0", "f = -5489.0"), "f = -5489 is not positive"),
    "a focal length in quotes": (toml("f = 5489.0", 'f = "5489"'), "'5489' is not a number"),
    "a focal length of any length": (toml("f = 5489.0", f"f = 1{'0' * 400}"), "f = "),
    "rows read sideways": (more('row_direction = "sideways"'), "use one of down, up, right, left"),
    "a negative readout": (more("readout_s = -0.03"), "readout_s = -0.03 is negative"),
    "a lever arm of two numbers": (more("[lever_arm]\ndefault = [0, 1]"), "not three numbers"),
    "a lever arm of no flight": (more("[lever_arm]\nF9 = [0, 0, 0]"), "names flight 'F9'"),
    "a table twice": (more("[sigma]\ntie_px = 0.5"), "block.toml, row 24: cannot declare"),
    "a key twice": (more("cx = 16.4\ncx = 16.4"), "block.toml, row"),
    "a block without a name": (toml('name = "', 'title = "'), "block has no name"),
    "cells in quotes with commas": (
        lambda folder: (folder / "gnss.csv").write_text(
            (folder / "gnss.csv").read_text().replace(",", '","')
        ),
        "columns image, z are missing",
    ),
}  # fmt: skip


@pytest.mark.parametrize("slip", REFUSED)
def test_is_refused_with_file_and_row(folder, slip):
    edit, words = REFUSED[slip]
    edit(folder)
    with pytest.raises(corridor.InputError, match=words) as refused:
        corridor.read(folder)
    assert ".csv" in str(refused.value) or "block.toml" in str(refused.value)


def test_a_sentence_is_one_line_also_of_names_with_line_breaks(folder, capsys):
    REFUSED["cells in quotes with commas"][0](folder)
    assert main(["summary", str(folder)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and len(said) < 400


# What an adjustment says: slip -> status, words of what it prints, options.
ADJUSTED = {
    "GNSS heights above the ellipsoid": (
        plus("gnss", z=43.0), 0, r"lever arm of flight F1 came out \d+\.\d m long.*geoid", ""
    ),
    "points of half-size pictures": (
        images(lambda f: f.assign(x=f["x"] / 2, y=f["y"] / 2)), 0, "0.50 times as long", ""
    ),
    "pixels counted from the middle": (
        images(lambda f: f.assign(x=f["x"] - WIDTH / 2, y=f["y"] - HEIGHT / 2)),
        0, "are pixels counted from the middle", "",
    ),
    "two control points exchanged": (
        table("ground", two_points), 0, "each lies where the other was surveyed", ""
    ),
    "a wild tie point": (cell("tie_points", 40, "x", 10), 0, "tie_points.csv, row 42", ""),
    "a wild GNSS position": (cell("gnss", 7, "x", 1e20), 0, "gnss.csv, row 9: image F", ""),
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
        lambda folder: None, 0, "gnss_drift is not shown by this block", "--effect gnss_drift"
    ),
    "y upwards": (
        images(lambda f: f.assign(y=HEIGHT - 1 - f["y"])), 1, "counted upwards", "--iterations 6"
    ),
    "GNSS in degrees": (degrees("gnss"), 1, "in degrees", "--iterations 6"),
    "GNSS sigmas in millimetres": (
        changed("gnss", sx=20.0, sy=20.0, sz=40.0), 0, "20 m in plan and 40 m in height", ""
    ),
    "GNSS sigmas a thousandth": (
        changed("gnss", sx=2e-5, sy=2e-5, sz=4e-5), 0, r"\d+ GNSS positions beyond 5 sigmas", ""
    ),
    "ground heights above the ellipsoid": (plus("ground", z=43.0), 0, "ellipsoid.*geoid", ""),
    "marks of points called otherwise": (
        changed("marks", point=lambda c: c.str.lower()), 0,
        "Control points G01, .* are not measured in any image", "",
    ),
    "one mark of another point": (
        table("marks", lambda f: f.assign(point=f["point"].where(f.index != 3, "G02"))), 0,
        "set aside, far from where its images show it.*: G02", "",
    ),
    "half the focal length": (toml("f = 5489.0", "f = 2744.0"), 0, "2.00 times as long", ""),
    "width and height exchanged": (
        both(toml("width = 5120", "width = 3840"), toml("height = 3840", "height = 5120")), 0,
        "pictures turned by 90 degrees", "",
    ),
    "quaternions with qw last": (
        table("images", lambda f: f.rename(columns=QW_LAST)), 2,
        "quaternion .world to camera, qw first", "",
    ),
    "GNSS in feet": (
        times("gnss", 3.28084, "x", "y", "z"), 1, "did not converge", "--iterations 6"
    ),
    "GNSS of other images": (
        table("gnss", lambda f: f.assign(image=f["image"].to_numpy()[::-1])), 1,
        "did not converge", "--iterations 6",
    ),
}  # fmt: skip


@pytest.mark.parametrize("slip", ADJUSTED)
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


class TestPositionsBesidePoses:
    """What `corridor gnss` says where images.csv has poses, and a block beside its gnss.csv."""

    poses = np.random.default_rng(1).uniform([0, 0, 40], [200, 60, 60], (30, 3))

    def told(self, given):
        return against("the track", given, "images.csv", self.poses)

    def test_what_agrees_is_not_told(self):
        assert self.told(self.poses + 0.5) == ""

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


# What is typed: words -> status, words of the last line.
TYPED = [
    ("adjust BLOCK --effect roling_shutter", 2, "did you mean rolling_shutter"),
    ("adjust BLOCK --effect rolling-shutter", 2, "did you mean rolling_shutter"),
    ("adjust BLOCK/tie_points.csv", 2, "is a file; give the folder of a block"),
    ("adjust NOWHERE", 2, "there is no such folder"),
    ("adjust BLOCK --camera f,cz", 2, "cz"),
    ("adjust BLOCK --loss hubert", 2, "hubert"),
    ("adjust BLOCK --control G99", 2, "no point G99|G99"),
    ("adjust BLOCK --prior camera.other.f=1+-1", 2, "other"),
    ("adjust BLOCK --effect water_refraction", 2, r"no level in a table \[effect.water_refraction"),
    ("correct BLOCK --effect rolling_shutter -o OUT", 2, "needs values|states none"),
    ("correct BLOCK --effect rolling_shutter:speed=1 -o OUT", 2, "no parameter 'speed'"),
    ("correct BLOCK --effect rolling_shutter:readout=x -o OUT", 2, "SLUG:PARAMETER=VALUE"),
    ("simulate thesis_50vz -o OUT", 2, "did you mean thesis_50v"),
    ("simulate thesis_50vt --effect rolling_shutter -o OUT", 2, "SLUG:PARAMETER=VALUE"),
    ("simulate thesis_50vt --effect gnss_bias.z:x=1 -o OUT", 2, "is unknown"),
    ("simulate thesis_50vt --seed -1 -o OUT", 2, "seed"),
    ("plan thesis_50vt --jobs 0", 2, "number of processes"),
    ("plan thesis_50vt --control x", 2, "numbers of control points"),
    ("plan thesis_50vt --bias -0.05,0", 2, "bias"),
    ("diagnose BLOCK --level 2", 2, "between 0 and 1"),
    ("diagnose BLOCK --counterparts 3", 2, "counterparts"),
    ("effects gremlins", 2, "gremlins"),
    ("gnss NOWHERE --images BLOCK -o OUT.csv", 2, "NOWHERE|nowhere"),
    ("export colmap NOWHERE -o OUT", 2, "nowhere|NOWHERE"),
    ("import colmap NOWHERE -o OUT", 2, "nowhere|NOWHERE"),
    ("adjust BLOCK -o FULL", 2, "FULL is a folder without adjustment.json"),
    ("simulate thesis_50vt -o FULL", 2, "FULL is a folder without block.toml"),
    ("plan thesis_50vt -o FULL", 2, "FULL is a folder without plan.json"),
]


@pytest.mark.parametrize(("typed", "status", "words"), TYPED, ids=[typed for typed, *_ in TYPED])
def test_what_is_typed_wrong_ends_in_a_sentence(sound, tmp_path, capsys, typed, status, words):
    full = tmp_path / "FULL"
    full.mkdir()
    (full / "mine.txt").write_text("mine")
    there = {"BLOCK": str(sound), "OUT": str(tmp_path / "OUT"), "NOWHERE": "NOWHERE"}
    for word, path in {**there, "FULL": str(full)}.items():
        typed = typed.replace(word, path)
    try:
        ended = main(typed.split())
    except SystemExit as stop:
        ended = stop.code
    said = capsys.readouterr().err
    assert ended == status, said
    assert pd.Series([said.splitlines()[-1]]).str.contains(words)[0], said
    assert "Traceback" not in said
    assert {path.name for path in tmp_path.iterdir()} == {"FULL"}


class TestWhereNothingCanBeWritten:
    """It is said before any work, and with the name that was typed."""

    @pytest.mark.parametrize("verb", ["adjust", "diagnose", "summary"])
    def test_no_permission(self, sound, tmp_path, capsys, monkeypatch, verb):
        monkeypatch.setattr("os.access", lambda *_, **__: False)
        assert main([verb, str(sound), "-o", str(tmp_path / "out")]) == 1
        last = capsys.readouterr().err.splitlines()[-1]
        assert last == f"failed: {tmp_path}: no permission to write there; nothing was written."

    def test_no_free_place(self, sound, tmp_path, capsys, monkeypatch):
        usage = type("Usage", (), {"free": 1000})
        monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
        assert main(["summary", str(sound), "-o", str(tmp_path / "out")]) == 1
        assert "no free place on this disk" in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []

    def test_hidden_names_are_not_told(self, sound, tmp_path, capsys, monkeypatch):
        def refused(self, *_, **__):
            hidden = str(tmp_path / ".out.0123abcd.part" / "x.csv")
            raise PermissionError(13, "Permission denied", hidden)

        monkeypatch.setattr(corridor, "read", refused)
        assert main(["adjust", str(sound), "-o", str(tmp_path / "out")]) == 1
        assert f"failed: {tmp_path / 'out' / 'x.csv'}: Perm" in capsys.readouterr().err
