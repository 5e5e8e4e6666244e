"""What is asked of two dates, and on which datum and points it stands."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made import adjusted, flown
from scipy.stats import chi2
from scipy.stats import t as student

import corridor
from benchmarks import change as benchmark
from corridor.core.errors import AdjustmentFailed, InputError
from corridor.interface.cli import main
from corridor.tools.change import Comparison, clouds, dates_of, make_cores, surface_change, volume
from corridor.tools.change.comparison import check_meeting, usual_datum
from corridor.tools.change.epoch import sound
from corridor.tools.change.joint import Joint


@pytest.mark.parametrize(
    "names",
    ["control, priors", ["control", "priors"], iter(["control", "priors"])],
    ids=["text", "list", "generator"],
)
def test_names_are_names_however_they_are_given(names):
    asked = Comparison(common=names, together=True)
    assert asked.common == ("control", "priors") and asked.common == ("control", "priors")


def test_a_name_is_no_list_of_letters():
    assert Comparison(common="control").common == ("control",)
    stays = Comparison(stable=(name for name in ("P1", "P2")), together=True)
    assert list(stays.stable) == list(stays.stable) == ["P1", "P2"]
    assert Comparison(stable="P1", together=True).stable == ("P1",)
    assert Comparison().stable is None


def coarse():
    """The flight of draw 10 on a receiver of metres, and no ground control."""
    block = flown(10)
    block.ground["role"] = "check"
    block.gnss[["sx", "sy", "sz"]] = [3.0, 3.0, 6.0]
    return block


def test_gnss_of_metres_alone_is_no_datum():
    """It scatters by centimetres about the flight; what all positions share shows nowhere."""
    block = coarse()
    here, there = adjusted(10), corridor.adjust(block)
    assert usual_datum((here, here)) == "stated"
    assert usual_datum((here, there)) == "stable"
    block.ground["role"] = flown(10).ground["role"]
    assert usual_datum((here, corridor.adjust(block))) == "stated"


@pytest.mark.slow
def test_dates_on_gnss_of_metres_are_laid_together_and_said_to_be():
    """A block that lies 2 m higher by its GNSS has not risen."""
    first, second = coarse(), coarse()
    second.gnss["z"] += 2.0
    found = corridor.change(first, second, same_ties=True, camera=False, spacing=12.0)
    assert found.asked.datum == "stable" and found.verdict == "nothing"
    assert "aligned on what stands still" in str(found)
    assert np.abs(found.surface.distance).max() < 0.05


def test_surfaces_out_of_reach_of_each_other_are_not_compared(pair, cores):
    higher = pair.after.xyz + [0.0, 0.0, 2.0 * cores.reach]
    check_meeting(pair.before.xyz, pair.after.xyz, cores)
    with pytest.raises(InputError, match="apart in height .median. where both show the ground"):
        check_meeting(pair.before.xyz, higher, cores)


def test_a_date_that_does_not_converge_tells_nothing():
    with pytest.raises(AdjustmentFailed, match="did not converge"):
        corridor.change(adjusted(10), corridor.adjust(flown(11), max_iterations=1))


def test_what_is_doubtful_about_a_date_is_told():
    """One image point in a hundred is 30 px off: it is left out, and the change says so."""
    spoilt = flown(11)
    spoilt.tie_points.loc[::100, "x"] += 30.0
    after = corridor.adjust(spoilt)
    found = corridor.change(adjusted(10), after, camera=False, same_ties=True, spacing=12.0)
    told = [text for text in corridor.change.of_change(found).warnings if "Second date" in text]
    assert told == [f"Second date: {text}" for text in found.final.adjustments[1].notes]
    assert "their matches are wrong" in told[0]
    assert after.sigma0 < 1.1 and found.final.adjustments[1].sigma0 < 1.1


def test_the_crest_of_a_dike_is_ground_and_a_wrong_match_is_none():
    """A trapezoid 4 m high, crest 4 m wide, slopes of 1 : 2, in a plain; noise of 2 cm."""
    draw = np.random.default_rng(4)
    xyz = draw.uniform([-50.0, 0.0, 0.0], [50.0, 200.0, 0.0], (4000, 3))
    xyz[:, 2] = np.clip(5.0 - 0.5 * np.abs(xyz[:, 0]), 0.0, 4.0) + draw.normal(0, 0.02, 4000)
    crest, dike = np.abs(xyz[:, 0]) < 2.0, np.abs(xyz[:, 0]) < 10.0
    assert sound(xyz)[crest].all() and sound(xyz)[dike].mean() > 0.95
    wrong = xyz.copy()
    wrong[::100, 2] -= 12.0
    found = sound(wrong)
    assert not found[::100].any() and np.delete(found, np.s_[::100]).mean() > 0.99


def halves(block, draw):
    """The block twice, with other tie points each: half of them, and the other half."""
    names = np.random.default_rng(draw).permutation(block.points["point"].to_numpy())
    parts = []
    for some in (names[::2], names[1::2]):
        part = block.copy()
        for table in ("tie_points", "points"):
            rows = getattr(part, table)
            setattr(part, table, rows[rows["point"].isin(some)].reset_index(drop=True))
        parts.append(part)
    return parts


@pytest.mark.slow
def test_other_tie_points_of_the_same_ground_change_no_more_than_stated():
    """Twelve dikes at rest, seen at other points each time: roughness is all of it.

    One cell in twenty is beyond the level of detection of 95 %, or fewer. Cells of a draw depend
    on each other, so the draws are the sample.
    """
    block = benchmark.dike(per_image=240)
    x, y = benchmark.middle(block)
    polygon = np.array([[x - 15, y - 10], [x + 15, y - 10], [x + 15, y + 10], [x - 15, y + 10]])
    volumes, beyond = [], []
    for draw in range(12):
        pair = [
            corridor.adjust(benchmark.flown(part, 700 + 2 * draw + k))
            for k, part in enumerate(halves(block, draw))
        ]
        joint = Joint(*clouds(*pair))
        cores = make_cores(joint.before.xyz, joint.after.xyz, spacing=8.0)
        surface = surface_change(joint, cores)
        one = volume(joint, polygon, cores)
        volumes.append(one.value / one.total)
        beyond.append(np.mean(np.abs(surface.distance) > surface.detection))
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], 12) / 12)
    assert low < np.sqrt(np.mean(np.square(volumes))) < high
    assert np.mean(beyond) < 0.05 + student.ppf(0.999, 11) * np.std(beyond, ddof=1) / np.sqrt(12)


def matched(folder):
    """Two flights over the dike in one block, written, as photographs of both come matched."""
    parts = []
    for draw, date in ((10, "2023/"), (11, "2024/")):
        part = flown(draw)
        for table in ("images", "tie_points", "marks", "gnss"):
            rows = getattr(part, table)
            rows["image"] = date + rows["image"].astype(str)
        parts.append(part)
    both = parts[0].copy()
    for table in ("images", "tie_points", "marks", "gnss"):
        rows = [getattr(part, table) for part in parts]
        setattr(both, table, pd.concat(rows, ignore_index=True))
    both.copy().write(folder)
    return folder


def test_two_dates_in_one_block_are_those_of_two_blocks(tmp_path, capsys):
    """Points move between the dates of one block as between the two flights."""
    both = matched(tmp_path / "both")
    first, second = dates_of(corridor.read(both), ["2023/", "2024/"])
    options = {"same_ties": True, "camera": False, "surface": False}
    together = corridor.change(first, second, **options)
    later = flown(11)
    later.ground = flown(10).ground  # one survey for both
    apart = corridor.change(flown(10), later, **options)
    np.testing.assert_allclose(together.points.shift, apart.points.shift, atol=1e-6)
    given = ["change", str(both), "--no-camera", "--points-only", "--dates"]
    assert main([*given, "2023/,2024/"]) == 0
    assert "No change is significant" in capsys.readouterr().out
    for wrong, said in (
        ("2023/,2025/", "no image is called 2025/"),
        ("2023/", "name two, one for each date"),
    ):
        assert main([*given, wrong]) == 2
        assert said in capsys.readouterr().err


def test_a_wall_is_called_steep_and_not_in_another_datum():
    """Heights of neighbours in plan differ by metres at one date already."""
    rng = np.random.default_rng(5)
    wall = [
        np.c_[rng.uniform(0, 40, 400), 0.03 * rng.normal(size=400), 30 * rng.random(400)]
        for _ in range(2)
    ]
    cores = SimpleNamespace(xyz=wall[0][:50], reach=0.7)
    with pytest.raises(InputError, match="steep.*--points-only"):
        check_meeting(*wall, cores)
    flat = [points * [1, 1000, 0] for points in wall]
    with pytest.raises(InputError, match="datum above all"):
        check_meeting(flat[0], flat[1] + [0, 0, 9.0], SimpleNamespace(xyz=flat[0][:50], reach=0.7))
