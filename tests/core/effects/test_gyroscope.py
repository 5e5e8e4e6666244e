"""A gyroscope's rates become turns: by hand, by an independent program, and in an adjustment."""

import numpy as np
import pandas as pd
import pytest
from hovering import hovering
from scipy.spatial.transform import Rotation
from strips import corridor_block

import corridor
from corridor.core.effects import add, predict
from corridor.core.effects.gyroscope import Gyroscope
from corridor.core.errors import InputError
from corridor.core.simulation import add_noise

READOUT = 0.05


def recorded(rates, time=None, **columns):
    """The hovering image with rates.csv; rates (n, 3) rad/s."""
    block = hovering()
    time = np.linspace(-0.1, 0.1, len(rates)) if time is None else time
    table = {"time_s": time, **dict(zip(("wx", "wy", "wz"), np.transpose(rates), strict=True))}
    return type(block)(**{**vars(block), "rates": pd.DataFrame(table | columns)})


def turn(block, begin, end):
    """Turn (3,) of the one image."""
    return Gyroscope(block).turn(np.array([0]), np.array([begin]), np.array([end]))[0][0]


def test_a_constant_rate_turns_by_rate_times_time():
    found = turn(recorded(np.tile([0.3, -0.2, 0.1], (50, 1))), -0.03, 0.05)
    assert found == pytest.approx(np.array([0.3, -0.2, 0.1]) * 0.08, abs=1e-12)


def test_turns_about_changing_axes_are_composed_as_scipy_composes_them():
    """A rocking wing: adding up angles would be wrong by half their product, here 0.4 mrad."""
    time = np.arange(-0.1, 0.1, 0.001)
    rates = np.stack([np.cos(30 * time), np.sin(30 * time), 0.3 + 0 * time], axis=1)
    fine = np.linspace(-0.08, 0.08, 160_001)
    middle = (fine[1:] + fine[:-1]) / 2
    steps = np.stack([np.cos(30 * middle), np.sin(30 * middle), 0.3 + 0 * middle], axis=1)
    steps = Rotation.from_rotvec(steps * np.diff(fine)[:, None])
    while len(steps) > 1:
        odd = steps[len(steps) - len(steps) % 2 :]
        steps = steps[: len(steps) // 2 * 2]
        steps = Rotation.concatenate([steps[0::2] * steps[1::2], odd])
    exact = steps[0].as_rotvec()
    found = turn(recorded(rates, time), -0.08, 0.08)
    assert found == pytest.approx(exact, abs=1e-6)
    added_up = np.array([np.sin(2.4) / 15, 0.0, 0.048])
    assert np.abs(added_up - exact).max() > 4e-4


def test_beyond_the_last_epoch_the_angle_goes_on():
    """data/sequoia: the record ends 33 ms before the last row is read."""
    found = turn(recorded(np.tile([0.0, 0.0, 0.5], (50, 1))), 0.0, 0.2)
    assert found == pytest.approx([0.0, 0.0, 0.1], abs=1e-12)


def test_a_right_turn_of_the_camera_moves_the_picture_to_the_left():
    """Rotation about y (down) by w t: a point in the middle of the last row moves by -f w t."""
    block = recorded(np.tile([0.0, 0.1, 0.0], (50, 1)))
    moved = predict(block, {"rolling_shutter_rotation": {"readout": READOUT, "delay": 0.0}}).tie
    still = predict(block).tie
    bottom, top = (moved - still)[2], (moved - still)[1]
    assert bottom[0] == pytest.approx(-5000 * 0.1 * READOUT / 2, rel=1e-3)
    assert top[0] == pytest.approx(+5000 * 0.1 * READOUT / 2, rel=1e-3)


def test_the_delay_looks_at_what_was_recorded_later():
    """A rate that grows by 10 rad/s2 is 0.2 rad/s larger 20 ms later."""
    time = np.linspace(-0.2, 0.2, 401)
    block = recorded(np.stack([0 * time, 10 * time, 0 * time], axis=1), time)
    late = predict(block, {"rolling_shutter_rotation": {"readout": READOUT, "delay": 0.02}}).tie
    shift = (late - predict(block).tie)[:, 0]
    # Turn from the middle to the last row: 0.2 t + 5 t2 with t = 25 ms.
    assert shift[2] == pytest.approx(-5000 * (0.2 * 0.025 + 5 * 0.025**2), rel=1e-2)
    assert shift[0] == pytest.approx(0.0, abs=1e-6)


def test_records_belong_to_images_or_flights():
    block = corridor_block(images=6, strips=2, flights=2, observations_per_image=30, gnss=False)
    time = block.images["time_s"].to_numpy()
    rows = [(t, 0.0, 0.0, float(k), f"F{k + 1}") for k in (0, 1) for t in (-99.0, 999.0)]
    block.rates = pd.DataFrame(rows, columns=["time_s", "wx", "wy", "wz", "flight"])
    found = Gyroscope(block).turn(np.arange(6), time, time + 0.1)[0][:, 2]
    assert found == pytest.approx([0, 0, 0, 0.1, 0.1, 0.1], abs=1e-12)


def test_one_epoch_alone_and_doubled_epochs_are_refused():
    with pytest.raises(InputError, match="rates.csv, row 2: one epoch alone"):
        Gyroscope(recorded([[0.1, 0.0, 0.0]], np.array([0.0])))
    with pytest.raises(InputError, match="there twice"):
        Gyroscope(recorded(np.zeros((3, 3)), np.array([0.0, 0.1, 0.1])))


@pytest.fixture(scope="module")
def rocking():
    """A strip whose camera rocks at 15 Hz by up to 2 degrees a second, and its gyroscope."""
    block = corridor_block(
        images=12, strips=2, observations_per_image=200, angular_rate_deg_s=0.0, seed=2
    )
    time = block.images["time_s"].to_numpy()[:, None] + np.arange(-0.1, 0.1, 0.001)
    phase = np.random.default_rng(1).uniform(0, 6.28, (3, len(block.images), 1))
    rate = np.radians(2.0) * np.sin(2 * np.pi * 15 * time + phase)
    block.rates = pd.DataFrame(
        {"time_s": time.ravel(), "image": np.repeat(block.images["image"], time.shape[1])}
        | dict(zip(("wx", "wy", "wz"), rate.reshape(3, -1), strict=True))
    ).reset_index(drop=True)
    values = {"rolling_shutter_rotation": {"readout": 0.08, "delay": 0.012}}
    return add_noise(add(block, values), tie_px=0.3, mark_px=0.3, gnss_m=0.01, control_m=0.01)


def test_readout_and_delay_are_found_together(rocking):
    found = corridor.adjust(rocking, camera="fixed", effects=["rolling_shutter_rotation"])
    table = found.effects.set_index("parameter")
    for name, true in (("readout", 0.080), ("delay", 0.012)):
        assert abs(table["value"][name] - true) < 4 * table["sigma"][name]
        assert table["sigma"][name] < 0.001
    assert not [w for w in found.warnings if "motion model" in w]


def test_a_motion_that_does_not_explain_the_pictures_is_called_so(rocking):
    """One rate an image, the mean of the record, where the camera rocks within a readout."""
    block = rocking.copy()
    rates = block.rates.groupby("image", sort=False)[["wx", "wy", "wz"]].mean()
    block.images[["wx", "wy", "wz"]] = rates.loc[block.images["image"]].to_numpy()
    found = corridor.adjust(block, camera="fixed", effects=["rolling_shutter"])
    said = [w for w in found.warnings if "motion model" in w]
    assert said and "rolling_shutter" in said[0] and "rates.csv" in said[0]
