"""One made-up flight of eight epochs in four forms of RTKLIB's .pos."""

from pathlib import Path

import numpy as np
import pytest

from corridor.core.errors import InputError
from corridor.core.gnss import Local, read_track, to_local

DATA = Path(__file__).parent / "data"
FORMS = {
    "llh.pos": ("GPST", "EPSG:4979", 30000.0),
    "llh_dms_utc.pos": ("UTC", "EPSG:4979", 29982.0),
    "xyz_tow.pos": ("GPST", "EPSG:4978", 30000.0),
    "enu_jst.pos": ("JST", None, 62382.0),
}
# Where the four forms print their ref pos.
PLACE = Local(45.83, -100.25, 230.0)


@pytest.mark.parametrize("name", FORMS)
class TestEveryForm:
    def test_states_time_system_day_and_kind_of_coordinates(self, name):
        track = read_track(DATA / name)
        system, crs, first = FORMS[name]
        assert (track.time_system, track.day, track.crs) == (system, "2024-06-24", crs)
        assert track.table["time_s"].tolist() == pytest.approx(first + 0.2 * np.arange(8), abs=1e-9)
        assert track.table["quality"].tolist() == [1, 1, 1, 2, 2, 1, 1, 1]

    def test_gives_the_same_positions_to_the_printed_digits(self, name):
        """0.1 mm printed; 9 decimals of a degree are 0.1 mm, 5 of a second 0.3 mm."""
        one = to_local(read_track(DATA / "llh.pos"), PLACE).positions()
        other = to_local(read_track(DATA / name), PLACE).positions()
        assert np.abs(one - other).max() < (3e-4 if "dms" in name else 1.5e-4)

    def test_gives_the_same_covariances_east_north_up(self, name):
        """The file prints 8, 12, 25 mm and signed roots -5 (e n), -7 (n u), 6 mm (u e)."""
        table = to_local(read_track(DATA / name), PLACE).table
        first = table[["sx", "sy", "sz", "rho_xy", "rho_yz", "rho_xz"]].iloc[0].to_numpy()
        assert first[:3] == pytest.approx([0.008, 0.012, 0.025], abs=2e-6)
        covariance = first[3:] * first[[0, 1, 0]] * first[[1, 2, 2]]
        assert covariance == pytest.approx([-25e-6, -49e-6, 36e-6], abs=5e-8)


def test_ref_pos_that_runs_together_is_read_by_its_decimals(tmp_path):
    """RTKLIB leaves no blank before a longitude below -99: 45.830000000-100.250000000."""
    text = (DATA / "enu_jst.pos").read_text()
    text = text.replace("45.830000000, -100.250000000,", "45.830000000-100.250000000 ")
    (tmp_path / "enu.pos").write_text(text)
    assert read_track(tmp_path / "enu.pos").origin == (45.83, -100.25, 230.0)


def test_a_baseline_without_ref_pos_is_local_and_says_so(tmp_path):
    text = "\n".join(x for x in (DATA / "enu_jst.pos").read_text().split("\n") if "ref" not in x)
    (tmp_path / "enu.pos").write_text(text)
    track = read_track(tmp_path / "enu.pos")
    assert track.crs is None and track.origin is None
    assert "no ref pos" in track.notes[0]


def test_velocities_come_east_first_though_written_north_first():
    table = read_track(DATA / "llh.pos").table
    assert table[["vx", "vy", "vz"]].iloc[0].tolist() == [11.6, 11.1, -0.3]
    assert table[["svx", "svy", "svz"]].iloc[0].tolist() == [0.02, 0.03, 0.05]


@pytest.mark.parametrize("separator", [";", "|", "\t", "   ", ", "])
def test_any_separator_will_do(tmp_path, separator):
    lines = []
    for line in (DATA / "enu_jst.pos").read_text().splitlines():
        lines.append(line if "ref pos" in line else line.replace(",", separator))
    (tmp_path / "x.pos").write_text("\n".join(lines))
    track = read_track(tmp_path / "x.pos")
    assert np.array_equal(track.positions(), read_track(DATA / "enu_jst.pos").positions())


def test_an_empty_field_does_not_let_the_next_move_up(tmp_path):
    text = (DATA / "enu_jst.pos").read_text().replace("       11.1154,", ",", 1)
    (tmp_path / "x.pos").write_text(text)
    with pytest.raises(InputError, match=r"x.pos, row 8: n-baseline = '' is not a number"):
        read_track(tmp_path / "x.pos")


def test_the_time_rises_across_the_end_of_a_week(tmp_path):
    text = (DATA / "xyz_tow.pos").read_text()
    for k in range(8):
        stamp = 604799.4 + 0.2 * k
        new = f"2321\t{stamp - 604800:.3f}" if stamp > 604799.99 else f"2320\t{stamp:.3f}"
        text = text.replace(f"2320\t{116400 + 0.2 * k:.3f}", new)
    (tmp_path / "week.pos").write_text(text)
    track = read_track(tmp_path / "week.pos")
    assert track.day == "2024-06-29"  # a Saturday
    assert np.diff(track.table["time_s"]) == pytest.approx(0.2, abs=1e-9)


def test_a_backward_solution_is_put_in_order_if_its_header_says_so(tmp_path):
    lines = (DATA / "llh.pos").read_text().splitlines()
    turned = [*lines[:1], "% solution  : Backward", *lines[1:7], *lines[:6:-1]]
    (tmp_path / "back.pos").write_text("\n".join(turned))
    track = read_track(tmp_path / "back.pos")
    assert "backward solution" in track.notes[0]
    assert track.table.equals(read_track(DATA / "llh.pos").table)


def test_a_file_of_windows_powershell_is_read(tmp_path):
    (tmp_path / "x.pos").write_bytes((DATA / "llh.pos").read_text().encode("utf-16"))
    assert read_track(tmp_path / "x.pos").table.equals(read_track(DATA / "llh.pos").table)


def test_epochs_without_solution_are_left_out_and_counted(tmp_path):
    text = (DATA / "llh.pos").read_text().replace("   2  15", "   0  15")
    (tmp_path / "x.pos").write_text(text)
    track = read_track(tmp_path / "x.pos")
    assert len(track.table) == 6 and "2 rows without solution" in track.notes[0]


def test_weeks_modulo_1024_are_refused(tmp_path):
    (tmp_path / "x.pos").write_text((DATA / "xyz_tow.pos").read_text().replace("2320\t", " 272\t"))
    with pytest.raises(InputError, match=r"x.pos, row 8: GPS week 272 .* add 1024 or 2048"):
        read_track(tmp_path / "x.pos")
