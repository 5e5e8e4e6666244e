"""A block with a track and no antenna positions: they come from the track."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from strips import corridor_block

from corridor.core.errors import InputError, WorkFailed
from corridor.core.gnss import Exposures, Track, antenna, of_block
from corridor.interface.cli import main

NOISE_M = 0.005


@pytest.fixture(scope="module")
def flown():
    """One calm strip at constant speed, its track at 5 Hz in place of gnss.csv."""
    block = corridor_block(
        images=12, strips=1, forward=0.85, attitude_jitter_deg=0.0, position_jitter=0.0,
        velocity_jitter=0.0, wind=0.0, observations_per_image=60, control=3, check=2, seed=2,
    )  # fmt: skip
    time = block.images["time_s"].to_numpy()
    epochs = np.arange(time[0] - 5, time[-1] + 5, 0.2)
    first, last = block.gnss[["x", "y", "z"]].to_numpy()[[0, -1]]
    share = (epochs - time[0]) / (time[-1] - time[0])
    place = first + share[:, None] * (last - first)
    place = place + NOISE_M * np.random.default_rng(1).standard_normal(place.shape)
    track = pd.DataFrame({"time_s": epochs, **dict(zip("xyz", place.T, strict=True))})
    track[["sx", "sy", "sz"]] = NOISE_M
    true = block.gnss[["x", "y", "z"]].to_numpy()
    block.gnss, block.track = block.gnss.iloc[:0], track
    return block, true


def test_positions_are_those_of_the_antenna_within_their_sigmas(flown):
    block, true = flown
    found = of_block(block).gnss
    off = found[["x", "y", "z"]].to_numpy() - true
    assert found["image"].tolist() == block.images["image"].tolist()
    # Smoothed over many epochs: better than one epoch, and four sigmas of what is stated.
    assert np.sqrt(np.mean(off**2)) < NOISE_M
    assert np.abs(off / found[["sx", "sy", "sz"]].to_numpy()).max() < 4


def test_clocks_that_do_not_meet_are_refused_not_stretched(flown):
    block = flown[0].copy()
    block.track = block.track.assign(time_s=block.track["time_s"] + 86400.0)
    with pytest.raises(InputError, match="common clock"):
        of_block(block)


def test_two_images_that_are_too_near_in_time_are_told(flown):
    block = flown[0].copy()
    assert not any("apart" in note for note in of_block(block).notes)
    time = block.images["time_s"].to_numpy(copy=True)
    time[7] = time[0] + 0.004
    block.images = block.images.assign(time_s=time)
    assert any("are 0.0040 s apart, others" in note for note in of_block(block).notes)


def test_an_image_out_of_the_order_of_times_is_told(flown):
    block = flown[0].copy()
    assert not any("out of the order" in note for note in of_block(block).notes)
    time = block.images["time_s"].to_numpy(copy=True)
    time[7] = 0.5 * (time[2] + time[3])
    block.images = block.images.assign(time_s=time)
    name = block.images["image"].iloc[7]
    assert any(f"{name} was taken at" in note for note in of_block(block).notes)
    block.images = flown[0].images.iloc[::-1].reset_index(drop=True)
    assert not any("out of the order" in note for note in of_block(block).notes)


def test_the_command_adjusts_with_them_and_says_so(flown, tmp_path, capsys):
    block, _ = flown
    block.write(tmp_path / "block")
    assert main(["adjust", str(tmp_path / "block"), "--camera", "fixed"]) == 0
    said = capsys.readouterr().out
    assert "Antenna positions of 12 of 12 images are interpolated from the track" in said
    assert "GNSS" in said


class TestWholeSeconds:
    """A drone that flies 5 m/s and fires every 2.4 s; a table that has lost the decimals."""

    @staticmethod
    def found(every_s, cut, **options):
        epochs = np.arange(0.0, 200.0, 0.2)
        place = np.outer(epochs, [5.0, 0.0, 0.0])
        track = pd.DataFrame({"time_s": epochs, **dict(zip("xyz", place.T, strict=True))})
        track[["sx", "sy", "sz"]] = NOISE_M
        true = np.arange(10.0, 190.0, every_s)
        table = pd.DataFrame({"image": [f"{k}" for k in range(len(true))]})
        table["time_s"] = np.floor(true) if cut else true
        there = Track(track, None, None, None, Path("track.csv"))
        made = antenna(there, Exposures(table, None, None, None, Path("images.csv")), **options)
        off = made.gnss["x"].to_numpy() - 5.0 * true
        return off / made.gnss["sx"].to_numpy(), made.notes

    def test_what_is_flown_meanwhile_is_in_the_sigmas_and_said(self):
        with pytest.raises(WorkFailed, match=r"above 0.1 m.*in steps of 1000 ms"):
            self.found(2.4, cut=True)
        off, notes = self.found(2.4, cut=True, max_sigma=10.0)
        assert np.sqrt(np.mean(off**2)) < 1.2
        assert any("in steps of 1000 ms: at 5.0 m/s 288.7 cm" in note for note in notes)

    @pytest.mark.parametrize(("every_s", "cut"), [(2.0, False), (2.4, False), (3.0, True)])
    def test_a_camera_that_fires_evenly_is_not_called_rounded(self, every_s, cut):
        off, notes = self.found(every_s, cut)
        assert np.abs(off).max() < 4
        assert not any("in steps of" in note for note in notes)
        # An even step of whole seconds may be cut all the same, by the same part of a second.
        told = any("are whole seconds: if" in note and "5.0 m along" in note for note in notes)
        assert told == (every_s != 2.4)
