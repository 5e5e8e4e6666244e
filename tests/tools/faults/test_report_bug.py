"""A copy for strangers: nothing in it tells whose it is, and the command ends on it as before."""

import numpy as np
import pandas as pd
import pytest
from block_folder import block_folder
from strips import corridor_block

import corridor
from corridor.core.block import LAYOUTS, read
from corridor.core.errors import InputError
from corridor.tools.faults import anonymous, reduction, report


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Two strips with a bit of everything, as somebody wrote them."""
    return read(block_folder(tmp_path_factory.mktemp("there")))


@pytest.fixture(scope="module")
def flown():
    """48 images whose names, place and day tell something."""
    made = corridor_block(48, 3, gnss=True)
    for table in ("images", "tie_points", "marks", "gnss"):
        frame = getattr(made, table)
        frame["image"] = frame["image"].astype(str).map("secret_{}.JPG".format)
    for table in ("images", "points", "ground", "gnss"):
        frame = getattr(made, table)
        frame["x"], frame["y"] = frame["x"] + 717_541.0, frame["y"] + 1_606_017.0
    made.images["time_s"] += 1.6e9
    return corridor.Block(**{
        name: getattr(made, name) for name in ("name", "cameras", *LAYOUTS, "sigma", "lever_arm")
    })  # fmt: skip


class TestTheCopy:
    def test_has_no_text_of_the_block_in_it(self, block, tmp_path):
        copy, names = anonymous(block)
        copy.write(tmp_path / "copy")
        written = "".join(
            path.read_text(encoding="utf-8") for path in (tmp_path / "copy").iterdir()
        )
        told = (
            "two strips/says/CC0/32647/717541/us/serial/0017/pilot/Ada/cloudy/note/007/old camera"
        )
        for word in (*told.split("/"), "once", "P1", "G1"):
            assert word not in written.replace("pixel_um", ""), word
        assert names["007"] == "i1" and names["old camera"] == "C2"

    def test_keeps_what_acts(self, block):
        copy, names = anonymous(block)
        camera = copy.cameras[names["P1"]]
        assert (camera["f"], camera["k1"]) == (3600.0, -0.05) and camera.readout_s == 0.025
        assert copy.lever_arm[names["B"]] == (0.0, 0.0, 0.5) and copy.lever_arm_fixed
        assert copy.sigma["tie_px"] == 0.7
        assert list(copy.ground["role"]) == list(block.ground["role"])

    def test_keeps_the_order_of_names_and_which_are_alike(self, block):
        copy, names = anonymous(block)
        for table in ("tie_points", "marks"):
            old, new = (getattr(one, table)["point"].astype(str) for one in (block, copy))
            assert list(old.map(names)) == list(new)
            assert list(np.argsort(old, kind="stable")) == list(np.argsort(new, kind="stable"))

    def test_keeps_distances_heights_and_intervals_to_the_last_bit(self, flown):
        copy, _ = anonymous(flown)
        for table in ("images", "gnss", "points", "ground"):
            for column in ("x", "y"):
                old, new = (one.column(table, column) for one in (flown, copy))
                assert np.array_equal(np.diff(old), np.diff(new)) or np.allclose(
                    np.diff(old), np.diff(new), atol=2 * np.spacing(1.7e6)
                )
                assert new.min() < 1000
            assert np.array_equal(flown.column(table, "z"), copy.column(table, "z"))
        assert 0 <= copy.column("images", "time_s").min() < 1

    def test_of_a_copy_is_that_copy(self, flown):
        once, _ = anonymous(flown)
        twice, _ = anonymous(once)
        for table in LAYOUTS:
            pd.testing.assert_frame_equal(getattr(once, table), getattr(twice, table))


@pytest.fixture
def ends(monkeypatch):
    """What `_ending` says, by the number of images and whether one of them is there."""

    def by(rule):
        tried = []

        def ending(copy, words):
            tried.append((len(copy.images), words))
            return rule(copy)

        monkeypatch.setattr(reduction, "_ending", ending)
        return tried

    return by


class TestTheSmallestPart:
    def test_is_the_first_that_ends_as_the_whole(self, flown, ends, tmp_path):
        """The fault needs 16 images: 8 end well in all three places."""
        tried = ends(
            lambda copy: (1, f"failed at {len(copy.images)}") if len(copy.images) > 15 else (0, "")
        )
        found = report(flown, "adjust", tmp_path / "out")
        assert [count for count, _ in tried] == [48, 8, 8, 8, 16]
        assert (found.images, found.whole, found.status, found.shown) == (16, 48, 1, True)
        assert len(read(tmp_path / "out" / "block").images) == 16
        text = (tmp_path / "out" / "fault.txt").read_text()
        assert text.startswith("corridor adjust\nstatus 1\nfailed at 16\n16 of 48 images\n")
        assert "numpy " in text and "secret" not in text

    def test_another_ending_is_not_the_fault(self, flown, ends, tmp_path):
        ends(lambda copy: (1, "failed: singular" if len(copy.images) == 48 else "failed: too few"))
        assert report(flown, "adjust", tmp_path / "out").images == 48

    def test_of_a_command_that_ends_well_the_first_images_are_taken(self, flown, ends, tmp_path):
        ends(lambda copy: (0, ""))
        found = report(flown, "adjust", tmp_path / "out")
        assert (found.images, found.shown) == (32, False)

    def test_names_in_the_command_are_those_of_the_copy(self, flown, ends, tmp_path):
        tried = ends(lambda copy: (2, "error"))
        point = flown.ground["point"].iloc[0]
        report(
            flown, f"adjust --check {point},X --effect lag:x.F1=0.1,y=1 --seed 1", tmp_path / "out"
        )
        (_, words), *_ = tried
        assert words[0] == "adjust" and words[1] == "--check" and words[2].startswith("p")
        assert words[2].endswith(",X") and words[3:] == [
            "--effect",
            "lag:x.F1=0.1,y=1",
            "--seed",
            "1",
        ]

    @pytest.mark.parametrize("command", ["", "dance", "change", "report-bug"])
    def test_a_command_that_does_not_take_one_block_is_refused(self, flown, command, tmp_path):
        with pytest.raises(InputError, match="does not begin with a verb"):
            report(flown, command, tmp_path / "out")

    def test_a_command_that_cannot_be_read_is_no_fault(self, flown, monkeypatch, tmp_path):
        said = "error: BLOCK is one word too many; see `corridor adjust --help`."
        monkeypatch.setattr(reduction, "_ending", lambda *_: (2, said))
        with pytest.raises(InputError, match="one word too many"):
            report(flown, "adjust BLOCK", tmp_path / "out")


@pytest.mark.slow
def test_a_real_command_is_run(flown, tmp_path):
    found = report(flown, "adjust --effect no_such_effect", tmp_path / "out")
    assert (found.images, found.status) == (8, 2) and "no_such_effect" in found.said
