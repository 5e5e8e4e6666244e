"""What cannot be adjusted is refused with one sentence: what, where, and what to do."""

import errno
import warnings

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects.forward import predict
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise
from corridor.interface.cli import main

QUATERNION = ["qw", "qx", "qy", "qz"]


def flown(noise=True, **options):
    options = {"images": 9, "strips": 3, "observations_per_image": 60, "seed": 4} | options
    block = corridor_block(**options)
    if not noise:
        return block
    return add_noise(block, tie_px=0.5, mark_px=0.3, gnss_m=0.02, control_m=0.01, seed=4)


@pytest.fixture(scope="module")
def made():
    return flown()


@pytest.fixture
def block(made):
    return made.copy()


def without_gnss(block):
    block.gnss = block.gnss.iloc[:0]
    return block


def refused(block, *words, **arguments):
    """The sentence with which the adjustment is refused; it must hold these words."""
    with pytest.raises(InputError) as caught:
        corridor.adjust(block, **arguments)
    sentence = str(caught.value)
    for word in words:
        assert word in sentence
    assert "\n" not in sentence
    assert len(sentence) < 600
    return sentence


def kept(block, table, rows):
    setattr(block, table, getattr(block, table)[rows].reset_index(drop=True))


def points_twice(block):
    """Keep the tie points that two images or more still show."""
    count = block.tie_points["point"].value_counts()
    kept(block, "tie_points", block.tie_points["point"].isin(count[count > 1].index))


class TestTooFewMeasurements:
    def test_a_tie_point_seen_once(self, block):
        name = block.tie_points["point"].iloc[0]
        again = block.tie_points["point"].duplicated()
        kept(block, "tie_points", (block.tie_points["point"] != name) | ~again)
        words = ("tie_points.csv, row 2", f"point {name}", "one image only", "remove the row")
        refused(block, *words, strict=True)
        adjusted = corridor.adjust(block)
        assert adjusted.converged and name not in set(adjusted.points["point"])
        assert (
            adjusted.warnings[0]
            == f"1 tie point is seen in one image only and is left out: {name}."
        )

    def test_a_check_point_seen_once(self, block):
        name = block.ground.loc[block.ground["role"] == "check", "point"].iloc[0]
        rows = block.marks["point"] == name
        kept(block, "marks", ~rows | ~block.marks["point"].duplicated())
        row = np.flatnonzero(block.marks["point"] == name)[0] + 2
        refused(block, f"marks.csv, row {row}", f"point {name}", "one image only", strict=True)
        adjusted = corridor.adjust(block)
        assert name not in set(adjusted.check_points["point"])
        assert (
            f"1 check point is seen in one image only and is left out: {name}." in adjusted.warnings
        )

    def test_a_control_point_seen_once_is_welcome(self, block):
        """Its coordinates carry it (Strasbourg has one)."""
        name = block.ground.loc[block.ground["role"] == "control", "point"].iloc[0]
        rows = block.marks["point"] == name
        kept(block, "marks", ~rows | ~block.marks["point"].duplicated())
        adjusted = corridor.adjust(block)
        assert adjusted.points.set_index("point").loc[name, "rays"] == 1

    def test_an_image_with_two_points(self, block):
        name = block.images["image"][4]
        number = block.tie_points.groupby("image", observed=True).cumcount()
        kept(block, "tie_points", (block.tie_points["image"] != name) | (number < 2))
        kept(block, "marks", block.marks["image"] != name)
        points_twice(block)
        words = ("images.csv, row 6", name, "a pose needs 3", "remove the image")
        sentence = refused(block, *words, strict=True)
        adjusted = corridor.adjust(block)
        assert adjusted.converged and name not in set(adjusted.poses["image"])
        assert len(adjusted.poses) == len(block.images) - 1
        assert any("1 image has fewer than 3 points" in w and name in w for w in adjusted.warnings)
        assert "has 2 measured points" in sentence or "has 1 measured point," in sentence

    def test_images_without_any_point(self, block):
        bare = corridor.Block(name="bare", cameras=block.cameras, images=block.images)
        refused(bare, "images.csv, row 2", "8 more images", "measure more")

    def test_strips_that_share_no_point(self):
        """A free network of two halves: nothing says where one lies to the other."""
        block = flown(noise=False, images=12, strips=2, gnss=False, control=0, check=0)
        strip = block.images.set_index("image")["strip"]
        of_row = block.tie_points["image"].astype(str).map(strip)
        first = of_row.groupby(block.tie_points["point"].astype(str)).transform("first")
        kept(block, "tie_points", of_row == first)
        points_twice(block)
        words = ("images.csv", "pose of image", "cannot be determined", "linked to the other")
        assert "rates.csv" not in refused(block, *words)
        times = np.linspace(0.0, 1.0, 5)
        block.images["time_s"] = np.linspace(0.0, 1.0, len(block.images))
        block.rates = pd.DataFrame({"time_s": times, "wx": 0.1, "wy": 0.0, "wz": 0.0})
        refused(block, *words, "rates.csv", "--effect rolling_shutter_rotation")


class TestBehindTheCamera:
    def test_a_flipped_quaternion_is_named_and_its_pose_found_anew(self, block):
        whole = corridor.adjust(block)
        block.images.loc[5, QUATERNION] = [1.0, 0.0, 0.0, 0.0]
        refused(block, "images.csv, row 7", "lie behind it", "check its quaternion", strict=True)
        adjusted = corridor.adjust(block)
        (told,) = [note for note in adjusted.warnings if "all points behind the image" in note]
        assert "images.csv" in told and block.images["image"][5] in told
        assert np.abs(adjusted.block.poses - whole.block.poses).max() < 1e-6

    def test_of_many_the_first_row_is_named_and_the_others_counted(self, block):
        """All look up: a quaternion camera to world of another frame, say."""
        block.images[QUATERNION] = [1.0, 0.0, 0.0, 0.0]
        refused(block, "images.csv, row 2", "8 more images too", "world to camera, qw first")

    def test_a_point_that_starts_behind_is_intersected_anew(self, block):
        block.points.loc[3, "z"] = 500.0
        adjusted = corridor.adjust(block)
        assert adjusted.converged
        assert abs(adjusted.block.points["z"][3]) < 10.0

    def test_a_point_that_starts_far_outside_every_picture_is_intersected_anew(self, block):
        """A slipped digit of one start value is no reason to blame the lens."""
        whole = corridor.adjust(block)
        block.points.loc[3, "y"] += 300.0
        adjusted = corridor.adjust(block)
        xyz = adjusted.block.points[["x", "y", "z"]]
        assert xyz.to_numpy() == pytest.approx(whole.block.points[xyz.columns].to_numpy(), abs=1e-3)


class TestSingularDatum:
    """Each sentence names the quantities, what there is, and the remedy."""

    def test_one_control_point(self, block):
        refused(
            without_gnss(block), "Position along x", "rotation about z", "scale",
            "by 1 control point:", "add control points or GNSS", control=["G01"],
        )  # fmt: skip

    def test_two_control_points_leave_the_turn_about_their_line(self, block):
        """G01 and G02 lie one behind the other along y."""
        sentence = refused(
            without_gnss(block), "rotation about y", "2 control points", control=["G01", "G02"]
        )
        assert "scale" not in sentence
        assert "rotation about z" not in sentence

    @pytest.mark.parametrize("camera", ["fixed", "fraser8"])
    def test_control_on_a_line_leaves_the_turn_about_it(self, camera):
        """Five points along x are no better than two."""
        block = flown(noise=False, gnss=False, control=5, check=0)
        block.ground = block.ground.assign(x=np.linspace(2.0, 12.0, 5), y=0.0, z=0.5)
        seen = predict(block).mark
        block.marks = block.marks.assign(x=seen[:, 0], y=seen[:, 1])
        sentence = refused(block, "rotation about x", "5 control points", camera=camera)
        assert "scale" not in sentence

    def test_one_antenna(self, block):
        block.gnss = block.gnss.iloc[:1]
        sentence = refused(block, "scale", "by 1 GNSS position:", control=[], lever_arm="fixed")
        assert "Position along x" in sentence

    def test_antennas_on_a_line_leave_the_turn_about_it(self):
        """One strip flown as with a ruler, along x."""
        options = dict(attitude_jitter_deg=0.0, position_jitter=0.0, relief=0.0)
        block = flown(noise=False, images=8, strips=1, lever_arm=(0.0, 0.0, 0.0), **options)
        sentence = refused(block, "otation about x", "8 GNSS positions", control=[],
                           lever_arm="fixed")  # fmt: skip
        assert "height" not in sentence.lower()

    def test_free_lever_arms_with_one_heading_leave_the_position(self):
        """A level camera on one heading moves its antenna as a shift of the block does."""
        block = flown(noise=False, images=12, turned=False, attitude_jitter_deg=0.0)
        refused(block, "Position along x, position along y and height", "with free lever arms",
                "hold lever arms", control=[], lever_arm="free")  # fmt: skip

    def test_free_lever_arms_of_a_level_camera_leave_the_height(self):
        """Turning round at the end of the strip parts x and y from the shift, z not."""
        block = flown(noise=False, images=12, attitude_jitter_deg=0.0)
        sentence = refused(block, "Height", "with free lever arms", control=[], lever_arm="free")
        assert "position along" not in sentence.lower()

    def test_lever_arms_that_nobody_asked_to_be_free_are_held_there(self):
        """As on a head of five cameras that flies level; the stated arm is the true one."""
        block = flown(noise=False, images=12, attitude_jitter_deg=0.0)
        adjusted = corridor.adjust(block, control=[])
        assert not adjusted.problem.arms_free
        assert any(
            "where the block lies" in note and "control points would say" in note
            for note in adjusted.notes
        )

    @pytest.mark.parametrize("effect", ["gnss_bias", "gnss_bias@flight"])
    def test_a_gnss_bias_without_control(self, block, effect):
        refused(
            block, "Position along x, position along y and height", "with effect gnss_bias",
            control=[], effects=[effect], lever_arm="fixed",
        )  # fmt: skip

    def test_one_control_point_is_enough_for_it(self, block):
        adjusted = corridor.adjust(block, control=["G01"], effects=["gnss_bias"], lever_arm="fixed")
        assert adjusted.converged

    def test_the_effect_lever_arm_beside_free_arms(self, block):
        refused(block, "lever_arm.F1.x", "cannot be determined", "leave the effect out",
                effects=["lever_arm"])  # fmt: skip

    def test_an_effect_that_moves_nothing(self, block):
        """A rolling shutter of a camera that stood still."""
        block.images[["vx", "vy", "vz", "wx", "wy", "wz"]] = 0.0
        refused(block, "rolling_shutter.readout", "cannot be determined", "leave the effect out",
                effects=["rolling_shutter"])  # fmt: skip

    def test_a_drift_at_one_time(self, block):
        block.images["time_s"] = 10.0
        refused(block, "focal_drift.rate", "cannot be determined", effects=["focal_drift"])

    @pytest.mark.slow
    def test_a_drift_of_each_image(self, block):
        """One epoch an image tells of no drift where its own time is the middle of the block."""
        block.images["time_s"] = 10.0
        refused(block, "rate of effect focal_drift cannot be determined for image",
                "focal_drift@flight", effects=["focal_drift@image"])  # fmt: skip


class TestWhatAnEffectNeeds:
    @pytest.mark.parametrize(
        "effect, columns, named",
        [
            ("focal_drift", ["time_s"], "images.csv has no time_s"),
            ("rolling_shutter", ["vx", "vy", "vz", "time_s"], "images.csv has no vx"),
        ],
    )
    def test_a_column_that_is_not_there(self, block, effect, columns, named):
        block.images = block.images.drop(columns=columns)
        refused(block, named, effect, "add the column or leave the effect out", effects=[effect])

    def test_one_time_that_is_not_known(self, block):
        block.images.loc[3, "time_s"] = np.nan
        name = block.images["image"][3]
        refused(block, "images.csv", name, "images.time_s", "fill the cell",
                effects=["focal_drift"])  # fmt: skip

    def test_gnss_that_is_not_there(self, block):
        refused(without_gnss(block), "gnss.csv", "gnss_bias", effects=["gnss_bias"])


WRONG = {
    "a camera parameter": (dict(camera="f,cx,q1"), ["q1", "fraser8"]),
    "no camera parameter": (dict(camera=","), ["camera parameter", "fraser8"]),
    "a camera": (dict(camera={"Nikon": "fixed"}), ["block.toml", "Nikon", "camlight"]),
    "an effect": (dict(effects=["gremlins"]), ["gremlins", "rolling_shutter"]),
    "an effect twice": (dict(effects=["gnss_bias", "gnss_bias@flight"]), ["gnss_bias", "once"]),
    "a group": (dict(effects=["gnss_bias@moon"]), ["moon", "flight"]),
    "a group that images have not": (dict(effects=["gnss_bias@point"]), ["gnss_bias", "point"]),
    "a control point": (dict(control=["GCP99"]), ["ground.csv", "GCP99", "G01"]),
    "a check point": (dict(check=["GCP99"]), ["ground.csv", "GCP99", "G01"]),
    "both roles": (dict(control=["G01", "G02"], check=["G02"]), ["G02", "control and check"]),
    "a prior": (dict(priors={"camera.P1.f": (8000.0, 1.0)}), ["camera.P1.f", "camera.camlight.f"]),
    "a prior's sigma": (dict(priors={"camera.camlight.f": (5489.0, 0.0)}), ["positive"]),
    "a prior's value": (dict(priors={"camera.camlight.f": (np.nan, 1.0)}), ["camera.camlight.f"]),
    "a lever arm": (dict(lever_arm="loose"), ["loose", "free or fixed"]),
    "threads": (dict(threads=0), ["threads", "1 or 2"]),
}


class TestWrongArguments:
    @pytest.mark.parametrize("what", WRONG)
    def test_are_named_with_what_there_is(self, block, what):
        arguments, words = WRONG[what]
        refused(block, *words, **arguments)

    @pytest.mark.parametrize(
        "loss", ["gauss:2", "huber:0", "huber:-1", "huber:x", "huber:inf", "huber:2:3", ""]
    )
    def test_a_loss_that_is_none(self, block, loss):
        refused(block, repr(loss), "squares, huber:2 or cauchy:2", loss=loss)


class TestTheCommand:
    """Status 2, the last line one sentence, nothing written."""

    @pytest.mark.parametrize(
        "words, named",
        [
            ("--control G01 --lever-arm fixed", "by 1 control point:"),
            ("--camera f,q1", "q1"),
            ("--loss gauss:2", "gauss:2"),
            ("--control GCP99", "GCP99"),
            ("--prior camera.P1.f=8190+-5", "camera.camlight.f"),
        ],
    )
    def test_ends_with_status_2(self, block, tmp_path, capsys, words, named):
        without_gnss(block).write(tmp_path / "block")
        out = tmp_path / "out"
        assert main(["adjust", str(tmp_path / "block"), "-o", str(out), *words.split()]) == 2
        shown = capsys.readouterr()
        last = shown.err.splitlines()[-1]
        assert last.startswith("error: ")
        assert named in last
        assert "Traceback" not in shown.err
        assert [path.name for path in tmp_path.iterdir()] == ["block"]

    def test_a_row_of_a_table_is_named(self, block, tmp_path, capsys):
        block.images[QUATERNION] = [1.0, 0.0, 0.0, 0.0]
        block.write(tmp_path / "block")
        out = tmp_path / "out"
        assert main(["adjust", str(tmp_path / "block"), "-o", str(out)]) == 2
        said = capsys.readouterr().err
        last = said.splitlines()[-1]
        assert last.startswith("error: ")
        assert "images.csv, row 2" in last
        assert "Traceback" not in said
        assert not out.exists()

    # Quick: test_cli.py, and test_report.py for every step of saving.
    @pytest.mark.slow
    @pytest.mark.parametrize("ending", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left")])
    def test_an_earlier_result_survives_an_interrupted_run(
        self, block, tmp_path, capsys, monkeypatch, ending
    ):
        """Ctrl-C or a full disk while the pictures are saved: what was there stays, whole."""
        block.write(tmp_path / "block")
        out = tmp_path / "out"
        words = ["adjust", str(tmp_path / "block"), "-o", str(out)]
        assert main(words) == 0
        before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}

        def stop(*_, **__):
            raise ending

        monkeypatch.setattr("matplotlib.figure.Figure.draw", stop)
        assert main([*words, "--camera", "fixed"]) == (1 if isinstance(ending, OSError) else 130)
        assert "nothing was written" in capsys.readouterr().err.splitlines()[-1]
        after = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
        assert after == before
        assert sorted(path.name for path in tmp_path.iterdir()) == ["block", "out"]


def test_a_block_with_velocities_and_no_positions_adjusts_without_a_foreign_word():
    block = corridor_block(images=8, strips=2, observations_per_image=40, gnss=False, control=3)
    block = block.with_(images=block.images.assign(vx=5.0, vy=0.0, vz=0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert corridor.adjust(block).warnings is not None


@pytest.mark.parametrize("sigma", [5.0, 0.01])
def test_control_stated_far_too_coarse_is_told(sigma):
    block = corridor_block(images=8, strips=2, observations_per_image=40, control=5)
    block = block.with_(ground=block.ground.assign(sx=sigma, sy=sigma, sz=sigma))
    told = [one for one in corridor.adjust(block).warnings if "hardly counts" in one]
    assert len(told) == (sigma > 1)


def test_an_empty_table_of_marks_is_none_to_correct():
    block = corridor_block(images=8, strips=2, observations_per_image=40)
    block = block.with_(marks=block.marks[:0])
    block.demand("marks", np.zeros((0, 3), dtype=bool), "has no place", "write one")


@pytest.mark.parametrize("width", [1e20, 2e6, 1.0, 2.5])
def test_no_camera_has_such_a_picture(width):
    with pytest.raises(InputError, match="not a picture size"):
        corridor.Camera.from_table("A", {"width": width, "height": 100, "f": 100})
