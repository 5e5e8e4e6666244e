"""Plans that nobody can fly get one clear sentence, before anything is computed."""

import sys
import time

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.simulation import Flight, Noise, Plan, read_plan, simulate

FLIGHT = '[[flight]]\nname = "a"\nheight_m = 50\n'
# What is written into PLAN.toml, and what the sentence says.
WRONG = {
    # --- what cannot be flown
    "overlap of 100 %": (FLIGHT + "forward = 1", "forward = 1 cannot be flown: give 0 to below 1"),
    "side overlap of 100 %": (FLIGHT + "side = 1.0", "overlap side = 1 cannot be flown"),
    "negative overlap": (FLIGHT + "forward = -0.1", "forward = -0.1 cannot be flown"),
    "negative height": ("[[flight]]\nheight_m = -50", "height_m = -50 is not above the ground"),
    "no height above ground": ("[[flight]]\nheight_m = [50, 0, 50]", "height_m = 0 is not above"),
    "a height in space": ("[[flight]]\nheight_m = 1e300", "cannot be the height of a drone"),
    "below the crest": ("[[flight]]\nheight_m = 2", "sees nothing: its lowest strip"),
    "a jitter down to the ground": (
        FLIGHT + "position_jitter_m = 20",
        "down to -30 m above the plain with its jitter",
    ),
    "rougher than it is high": ("[terrain]\nroughness_m = 20\n" + FLIGHT, "sees nothing"),
    "past the horizon": (FLIGHT + "tilt_deg = 75", "looks past the horizon: tilt_deg = 75"),
    "past the horizon sideways": (FLIGHT + 'tilt_deg = 62\nlook = "sideways"', "past the horizon"),
    "past the horizon in the wind": (
        FLIGHT + "tilt_deg = 45\nattitude_jitter_deg = 10",
        "a jitter of 30 degrees",
    ),
    "looking up": (FLIGHT + "tilt_deg = 120", "tilt_deg = 120 does not look down"),
    # 37.5 m at most, in 200 m: six of 33.3 m, and pictures that are 35 m long.
    "one strip that sees nothing twice": (
        FLIGHT + "strips = 1\nspeed_m_s = 15",
        "one strip with 33.3 m between exposures",
    ),
    "wind that stops a drone": (FLIGHT + "wind_m_s = -9", "a wind of -9 m/s stops a drone"),
    # --- too much
    "10^7 images": (FLIGHT + "images = 10000000", "1e+07 images, more than 1e+06"),
    "10^7 images by overlap": (FLIGHT + "forward = 0.999999", "images, more than 1e+06"),
    "a corridor round the moon": ("axis_m = [[0, 0], [1e7, 0]]\n" + FLIGHT, "more than 1e+06"),
    "10^6 images of two flights": (
        FLIGHT + 'images = 600000\n[[flight]]\nname = "b"\nheight_m = 60\nimages = 600000',
        "the plan has 1.2e+06 images",
    ),
    "10^9 strips": (FLIGHT + "strips = 1000000000", "strips = 1000000000 are more than 10000"),
    "a strip in space": (FLIGHT + "strips = 1\noffsets_m = [1e20]", "far from any corridor"),
    "10^20 images at an overlap": (
        FLIGHT + f"images = {10**20}\nforward = 0.8",
        "1e+20 images, more than 1e+06",
    ),
    "10^9 tie points": ("[tie_points]\nper_image = 1000000000\n" + FLIGHT, "lower per_image"),
    "10^9 control points": ("[ground]\ncontrol = 1000000000\n" + FLIGHT, "more than 100000 points"),
    "a point a micrometre": ("[ground]\nevery_m = 1e-6\n" + FLIGHT, "every_m = 1e-06 makes more"),
    # --- too little
    "an empty plan": ("", "has no flight: add a table [[flight]]"),
    "no height": ('[[flight]]\nname = "a"', "flight a lacks height_m: add it"),
    "one image": (FLIGHT + "images = 5", "5 images cannot fly 3 strips"),
    "a strip without images": (
        "[[flight]]\nheight_m = [30, 300]\nstrips = 2\nimages = 4\nforward = 0.8",
        "only 0 fall to strip 2",
    ),
    "no strips": (FLIGHT + "strips = 0", "strips = 0 is below 1"),
    "a border as wide as the picture": (
        "[tie_points]\nborder_px = 1920\n" + FLIGHT,
        "border_px = 1920 leaves nothing of 5120 x 3840 px",
    ),
    "a matcher that needs bigger than big": (
        "[tie_points]\nmatch_scale = 0.5\n" + FLIGHT,
        "match_scale = 0.5 is below 1",
    ),
    "a matcher that knows nothing again": (
        "[tie_points]\nmatch_angle_deg = 0\n" + FLIGHT,
        "match_angle_deg = 0 matches nothing",
    ),
    "stations without length": (FLIGHT + "stations_m = [80, 80]", "has no length"),
    # --- what contradicts itself
    "the same thing twice": (
        FLIGHT + "forward = 0.8\nspeed_m_s = 3\ninterval_s = 2.5",
        "forward, speed_m_s and interval_s say the same thing twice",
    ),
    "two flights of one name": (FLIGHT + FLIGHT, "flight a is there twice"),
    "heights for other strips": (
        "[[flight]]\nheight_m = [30, 70]",
        "height_m gives 2 heights for 3 strips",
    ),
    "offsets for other strips": (FLIGHT + "offsets_m = [0]", "offsets_m gives 1 offsets for 3"),
    # --- the axis
    "an axis that doubles back": (
        "axis_m = [[0, 0], [0, 100], [0, 20]]\n" + FLIGHT,
        "turns back on itself",
    ),
    "an axis of one point": ("axis_m = [[0, 0]]\n" + FLIGHT, "two or more positions"),
    "an axis that leaves the Earth": (
        "axis_m = [[1e20, 0], [0, 0]]\n" + FLIGHT,
        "not a place on Earth",
    ),
    "an axis that stands still": ("axis_m = [[0, 0], [0, 0]]\n" + FLIGHT, "a position twice"),
    "an axis in space": ("axis_m = [[0, 0, 0], [0, 9, 0]]\n" + FLIGHT, "3 values, 2 are needed"),
    "a bend without a radius": ("bend_radius_m = 0\n" + FLIGHT, "is not greater than 0"),
    "an axis in degrees": (
        "axis_m = [[8.55, 49.01], [8.56, 49.012]]\n" + FLIGHT,
        "axis_m is in metres, not in degrees or kilometres",
    ),
    "a readout in milliseconds": (
        "[camera.own]\nwidth = 4000\nheight = 3000\nf = 3000\nreadout_s = 25\n"
        + FLIGHT
        + 'camera = "own"',
        "readout_s = 25 is longer than any shutter: it is in seconds, 25 ms are 0.025",
    ),
    "a pixel in millimetres": (
        "[camera.own]\nwidth = 4000\nheight = 3000\nf = 3000\npixel_um = 0.0033\n"
        + FLIGHT
        + 'camera = "own"',
        "smaller than the waves of light: it is in micrometres, 0.0033 mm are 3.3",
    ),
    # --- what is misspelled
    "a key": (FLIGHT + "forwrad = 0.8", "no key 'forwrad' (did you mean forward?)"),
    "a key of the plan": ("axsi_m = 3\n" + FLIGHT, "no key 'axsi_m' (did you mean axis_m?)"),
    "a key of a table": ("[noise]\ntie_pix = 1\n" + FLIGHT, "'tie_pix' (did you mean tie_px?)"),
    "flights": ("[[flights]]\n" + FLIGHT, "no key 'flights': write [[flight]]"),
    "cameras": ("[cameras.own]\nf = 3\n" + FLIGHT, "no key 'cameras': write [camera.NAME]"),
    "a camera": (FLIGHT + 'camera = "camlite"', "'camlite' is known (did you mean camlight?)"),
    "a word": (FLIGHT + 'look = "up"', "look = 'up' is unknown: use forward or sideways"),
    "a heading": (FLIGHT + 'heading = "back"', "use turned or kept"),
    "a direction": (FLIGHT + 'direction = "other"', "use alternating or same"),
    "a side": (FLIGHT + 'long_side = "up"', "use across or along"),
    "a layout": ('[ground]\nlayout = "dense"\n' + FLIGHT, "use alternating or spread"),
    "an effect": ("[effects.shutter]\nreadout = 1\n" + FLIGHT, "'shutter' is unknown"),
    "a parameter": ("[effects.rolling_shutter]\nreadot = 1\n" + FLIGHT, "no parameter 'readot'"),
    "a flight of an effect": (
        "[effects.lever_arm_per_flight]\nx = { b = 1.0 }\n" + FLIGHT,
        "lever_arm_per_flight has no flight 'b'",
    ),
    "a parameter of the camera": ("[start.camera]\nfocal = 1\n" + FLIGHT, "no parameter 'focal'"),
    # --- wrong sorts
    "text for a number": ('[[flight]]\nheight_m = "50"', "'50' is not a number or a list"),
    "half an image": (FLIGHT + "images = 42.5", "images = 42.5 is not a whole number"),
    "a number for yes or no": ("gnss = 1\n" + FLIGHT, "gnss = 1 is not true or false"),
    "yes for a number": (FLIGHT + "tilt_deg = true", "tilt_deg = True is not a number"),
    "infinitely fast": (FLIGHT + "speed_m_s = inf", "speed_m_s = inf is not a number"),
    "not a number": (FLIGHT + "turn_s = nan", "turn_s = nan is not a number"),
    "a number for a table": ("terrain = 3\n" + FLIGHT, "terrain is a table, not 3"),
    "a number for a flight": ("flight = [3]", "flights are tables [[flight]]"),
    "one flight only": ("[flight]\nheight_m = 50", "flights are tables [[flight]]"),
    "two numbers for three": ("[noise]\ngnss_m = [1, 2]\n" + FLIGHT, "2 values, 3 are needed"),
    "a number for an effect": ("[effects]\nrolling_shutter = 3\n" + FLIGHT, "is a table of its"),
    "text for an effect": (
        '[effects.rolling_shutter]\nreadout = "fast"\n' + FLIGHT,
        "readout = 'fast' is not a number",
    ),
    "text for a start value": ('[start.camera]\nf = "50"\n' + FLIGHT, "f = '50' is not a number"),
    # --- wrong sizes
    "negative jitter": (FLIGHT + "attitude_jitter_deg = [1, -1, 1]", "is below 0"),
    "negative noise": ("[noise]\ntie_px = -1\n" + FLIGHT, "tie_px = -1.0 is below 0"),
    "more outliers than points": ("[noise]\noutliers = 2\n" + FLIGHT, "outliers = 2 is a share"),
    "negative start error": ("[start]\ncentre_m = -1\n" + FLIGHT, "centre_m = -1.0 is below 0"),
    "no time between exposures": (FLIGHT + "interval_s = 0", "interval_s = 0 is not greater"),
    "a negative speed": (FLIGHT + "speed_m_s = -3", "speed_m_s = -3 is not greater than 0"),
    "points every nought metres": ("[ground]\nevery_m = 0\n" + FLIGHT, "every_m = 0 is not"),
    "negative control": ("[ground]\ncontrol = -1\n" + FLIGHT, "control = -1 is below 0"),
    "no tie points": ("[tie_points]\nper_image = 0\n" + FLIGHT, "per_image = 0 is below 1"),
    "an antenna effect without antennas": (
        "gnss = false\n[effects.clock_offset]\noffset = 0.1\n" + FLIGHT,
        "gnss.csv has no x",
    ),
    # --- cameras of the plan's own
    "half a camera": ("[camera.own]\nwidth = 4000\n" + FLIGHT, "[camera.own] has no height"),
    "a camera that folds": (
        "[camera.own]\nwidth = 4000\nheight = 3000\nf = 3000\nk1 = -2\n"
        + FLIGHT
        + 'camera = "own"',
        "its distortion folds inside the picture",
    ),
    # --- the file
    "broken TOML": ("[[flight]\nheight_m = 50", "is not valid TOML"),
    "a key twice": (FLIGHT + "height_m = 60", "is not valid TOML"),
    "a flight without a name": ('[[flight]]\nname = ""\nheight_m = 50', "cannot be called ''"),
    "a name of two lines": ('[[flight]]\nname = "a\\nb"\nheight_m = 50', "cannot be called 'a\\n"),
}


@pytest.fixture(autouse=True)
def nothing_may_be_computed(monkeypatch):
    """The package offers `simulate` under the module's own name."""

    def fail(*_):
        pytest.fail("the plan was flown before it was refused")

    for name in ("fly", "Network"):
        monkeypatch.setattr(sys.modules["corridor.core.simulation.simulating"], name, fail)


def refused(*args, **options):
    with pytest.raises(InputError) as caught:
        simulate(*args, **options)
    sentence = str(caught.value)
    assert "\n" not in sentence and len(sentence) < 500
    return sentence


@pytest.mark.parametrize(("text", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_plan_that_cannot_be_flown_is_refused_in_one_sentence(text, says, tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(text, encoding="utf-8")
    assert says in refused(path)


def test_a_right_plan_is_flown_so_that_the_guard_would_bite(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(FLIGHT)
    with pytest.raises(pytest.fail.Exception, match="flown before it was refused"):
        simulate(path)


@pytest.mark.parametrize(
    "key", ["10^7 images", "10^7 images by overlap", "a corridor round the moon", "10^9 strips"]
)
def test_a_plan_of_ten_million_images_is_refused_at_once(key, tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(WRONG[key][0])
    refused(path)
    began = time.process_time()
    refused(path)
    # A few milliseconds; the limit leaves room for a busy machine.
    assert time.process_time() - began < 0.5


def test_the_sentence_names_the_file(tmp_path):
    path = tmp_path / "dam.toml"
    path.write_text(FLIGHT + "forwrad = 0.8")
    assert refused(path).startswith(str(path))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    assert "cannot be read (No such file" in refused(tmp_path / "nowhere.toml")


def test_a_file_that_is_not_text_is_refused(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_bytes(b"\xff\xfe\x00")
    assert "is not UTF-8" in refused(path)


@pytest.mark.parametrize("name", ["thesis_50v", "thesis_50vt+thesis_50v", "thesis-50vt"])
def test_a_name_that_nobody_knows_is_refused_with_the_nearest_and_the_list(name):
    sentence = refused(name)
    assert "did you mean thesis_50vt?" in sentence and "thesis_viabon_o60" in sentence


@pytest.mark.parametrize("name", ["", "thesis_50vt+", "/"])
def test_what_is_no_name_is_refused(name):
    assert "comes with corridor" in refused(name)


def test_a_plan_flown_twice_is_refused():
    assert "flight 50vt is there twice" in refused("thesis_50vt+thesis_50vt")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"effects": {"rolling_shuter": {"readout": 0.1}}}, "'rolling_shuter' is unknown"),
        ({"effects": {"rolling_shutter": {"readout": np.nan}}}, "readout = nan is not a number"),
        ({"effects": {"rolling_shutter": None}}, "is a table of its parameters, not None"),
        ({"effects": {"rolling_shutter@flight": {"readout": {"b": 1.0}}}}, "no flight 'b'"),
        ({"noise": {"tie": 1.0}}, "noise has no key 'tie' (did you mean tie_px?)"),
        ({"noise": {"tie_px": "much"}}, "tie_px = 'much' is not a number"),
        ({"noise": {"outliers": None}}, "outliers = None is not a number"),
        ({"noise": {"gnss_m": (1.0, 2.0)}}, "2 values, 3 are needed"),
        ({"noise": {"tie_px": -1.0}}, "tie_px = -1.0 is below 0"),
        ({"noise": 0.5}, "noise is a table, not 0.5"),
        ({"start": {"centre": 1.0}}, "start has no key 'centre' (did you mean centre_m?)"),
        ({"start": {"camera": {"f": np.inf}}}, "f = inf is not a number"),
        ({"start": {"camera": {"k9": 1.0}}}, "no parameter 'k9'"),
        ({"seed": -1}, "seed = -1 is not a whole number from 0"),
        ({"seed": 1.5}, "seed = 1.5 is not a whole number from 0"),
    ],
)
def test_what_a_call_adds_is_checked_as_well(options, says):
    assert says in refused(Plan("p", (Flight("a", 50.0),)), **options)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Flight("a", float("nan")),
        lambda: Flight("a", 50.0, tilt_deg=float("nan")),
        lambda: Flight("a", 50.0, speed_m_s=float("nan")),
        lambda: Noise(tie_px=float("nan")),
        lambda: Plan("p", ()),
        lambda: Plan("p", (Flight("a", 50.0, camera="none"),)),
    ],
)
def test_plans_made_in_python_are_checked_when_they_are_made(make):
    with pytest.raises(InputError):
        make()


def test_numbers_of_numpy_are_numbers():
    """A sweep over `np.arange` is what a notebook writes."""
    plan = Plan("p", (Flight("a", 50.0),))
    with pytest.raises(pytest.fail.Exception):
        simulate(
            plan,
            {"rolling_shutter": {"readout": np.float32(0.03)}},
            seed=np.int64(3),
            noise={"tie_px": np.int64(1), "gnss_m": np.array([0.01, 0.02, 0.03])},
            start={"camera": {"f": np.int64(50)}},
        )


def test_a_byte_order_mark_at_the_head_is_no_fault(tmp_path):
    """Windows' editor writes one."""
    (tmp_path / "plan.toml").write_text(FLIGHT, encoding="utf-8-sig")
    assert read_plan(tmp_path / "plan.toml").flights[0].height_m == 50.0


def test_a_whole_number_of_any_length_is_no_number(tmp_path):
    """TOML has integers of any length; no float holds this one as finite."""
    path = tmp_path / "plan.toml"
    path.write_text(f'name = "p"\naxis_m = [[0, 0], [1{"0" * 400}, 1]]\n')
    with pytest.raises(InputError, match="plan.toml: .*axis_m"):
        read_plan(str(path))
