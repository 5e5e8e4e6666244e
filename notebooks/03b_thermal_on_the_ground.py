# ---
# jupyter:
#   jupytext:
#     cell_metadata_filter: tags,-all
#     formats: ipynb,py:percent
#     notebook_metadata_filter: kernelspec,jupytext,-jupytext.text_representation.jupytext_version
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#   kernelspec:
#     display_name: Python 3 (ipykernel)
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The camera warms up: what does it cost on the ground?
#
# The notebook before this one measured how a picture grows with its camera's temperature. Here it
# flies: **when does it cost millimetres, and when can one leave it alone?** Chapter 6 of Zhou's
# thesis (2019) and Daakir et al. (2019) found 1.4 to 3.5 times better ground points after
# correcting it. We do the same where the truth is known, and put their numbers beside ours: some
# come out, some do not.
#
# You need to know what a focal length and a bundle adjustment are.
# *Run time on one core: about 80 seconds; in the fast form about 40 seconds.*

# %% tags=["parameters"]
fast = False  # fewer draws
seed = 0
draws = 10
slope_px = 0.075  # growth of the focal length with a degree

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from kit import drawings
from kit.heat import (
    HELD,
    LOOPS,
    STRONG,
    TIMES,
    camlight,
    held_by_gnss,
    on_the_road,
    pylon,
)
from kit.published import Draws, compare
from kit.real import without_images
from kit.ring import ring_block

import corridor
from corridor import figures, thermal
from corridor.simulation import CAMLIGHT, add_noise, perfect_block, read_plan

seeds = range(seed, seed + (3 if fast else draws))
heat = camlight(scale=slope_px / CAMLIGHT["f"])

# %% [markdown]
# ## 1. Two calibrations, one number (eq. 6.4)
#
# The thesis calibrates twice, with raw and with corrected points, and finds 0.23 px between the
# two cameras, 0.33 px at the border, for a temperature that changed by 1.6 °C. A rotation is taken
# out first. What does a change of f alone give? The slope is known as 0.07 to 0.08 px a degree:

# %%
differences = {
    (degrees, slope): thermal.compare_cameras(
        CAMLIGHT, CAMLIGHT.with_values(f=CAMLIGHT["f"] + slope * degrees)
    )
    for degrees in (1.6, 10.3)
    for slope in (0.07, slope_px, 0.08)
}
for (apart, slope), difference in differences.items():
    print(
        f"{apart:4.1f} degrees, {slope:.3f} px/C: mean {difference.mean:.3f} px, "
        f"side {difference.side:.3f} px"
    )
figures.camera_difference(
    differences[10.3, slope_px], "the calibration at 35.1 °C and the camera at 24.8 °C"
)

# %% [markdown]
# For the 1.6 °C that the camera warmed meanwhile it is a sixth of the published numbers. It comes
# close for 10.3 °C, the distance from the calibration (34.2 to 36 °C) to the temperature at
# which the model is zero: within the printed hundredth with 0.07 px a degree, 0.02 px off with
# 0.075. That this is the reason is a guess, made with these numbers; they cannot confirm it.
#
# ### The calibration done again
#
# So let us calibrate: 43 convergent pictures of a field with 28 targets, GSD about a millimetre,
# targets good to 0.5 mm, while the camera warms from 34.2 to 36 °C (table 6.12; the shape of the
# field is not published, ours is a drum). Guess: does the fit at the targets get better when the
# points are corrected?

# %%
rows = []
for draw in seeds:
    field = ring_block(
        stations=22, distance_m=6.5, radius_m=2.5, control=28,
        temperature_c=(34.2, 36.0), minutes=6.0, seed=draw,
    )  # fmt: skip
    field = without_images(field, np.arange(44) == 43)
    noise = {"tie_px": 0.3, "mark_px": 0.5, "control_m": 0.0005}
    warm = add_noise(thermal.uncorrect(field, heat)[0], **noise, seed=draw)
    twice = [corridor.adjust(b, camera="fraser8") for b in (warm, thermal.correct(warm, heat)[0])]
    cameras = [next(iter(a.block.cameras.values())) for a in twice]
    difference = thermal.compare_cameras(*cameras)
    marks = [a.observations.loc["mark", "rms_px"] for a in twice]
    rows.append([difference.mean, difference.side, *marks])
columns = ["cameras differ, mean (px)", "at the side (px)", "targets, raw (px)", "corrected (px)"]
pd.DataFrame(rows, columns=columns).agg(["median", "min", "max"]).round(3)

# %% [markdown]
# The targets fit alike, as the thesis saw: 1.8 °C during the calibration are nothing. And the two
# cameras differ as if by the eleven degrees from 24 °C, where the model is zero, to the
# calibration: in size like the published 0.23 and 0.33 px. The fit of a calibration does not show
# its temperature.
#
# ## 2. The pylon
#
# 28 pictures around a pylon while the camera warms from 23 to 31 °C, self-calibrated, transformed
# onto 13 targets by a similarity (closed loop); and with no tie points across the ends, where the
# two ends see the same points twice (open loop). Guess: which error of a tie point, in pixels,
# hides the heat?

# %%
drawings.ring(ring_block(seed=seed), "a ring of 28 pictures, every second one turned")

# %%
found_at = {
    (tie, closed): np.array([pylon(heat, tie, closed, d) for d in seeds])
    for tie in (0.01, 0.1, 0.3)
    for closed in (True, False)
}
rows = []
for (tie, closed), found in found_at.items():
    column = 0 if closed else 1
    raw, corrected = found[:, :, column].mean(axis=0)
    rows.append([tie, "closed" if closed else "open", raw, corrected, raw / corrected])
table = pd.DataFrame(
    rows, columns=["tie points (px)", "loop", "raw (mm)", "corrected (mm)", "gain"]
)
table.round({"raw (mm)": 3, "corrected (mm)": 3, "gain": 1})

# %% [markdown]
# At 0.3 px, typical of tie points, the noise hides the effect. At a hundredth of a pixel the
# correction is worth a factor of three; at three tenths the camera's pose takes up the growing
# picture, and the noise does the rest. But the published 4.7 and 3.2 mm are *twenty times* ours:
# whatever bent that network, it was not the heat alone. What would leave millimetres?

# %%
rows = {}
ways = {
    "as above, tie points 0.3 px": {},
    "twice the distance": {"distance_m": 11.0, "radius_m": 3.0, "height_m": 8.0},
    "ten stations in place of 14": {"stations": 10},
    "500 tie points in place of 1500": {"points": 500},
    "tie points 1 px": {"tie": 1.0},
    "a camera of 10 parameters": {"camera": "fraser10"},
    "targets measured to 5 px": {"mark_px": 5.0},
    "targets known to 2 mm": {"targets_mm": 2.0},
}
for words, change in ways.items():
    tie = change.pop("tie", 0.3)
    found = np.mean([pylon(heat, tie, True, d, **change)[:, 0] for d in list(seeds)[:3]], axis=0)
    rows[words] = [*found, found[0] / found[1]]
pd.DataFrame.from_dict(rows, orient="index", columns=["raw (mm)", "corrected (mm)", "gain"]).round(
    2
)

# %% [markdown]
# Targets that are known to 2 mm leave 3.0 mm, and 3.2 are published *after* the correction: so it
# was the targets that were left, in the pictures or in the survey, and not the network. The 1.5 mm
# that the correction gained are **not reproduced**: whatever else is changed, a self-calibrated
# ring takes the heat up. (The open loop's 6.2 mm are of the size of ours, but ours are noise, and
# the correction leaves them.)
#
# How strong would the heat have to be? Take it many times as strong, with the camera estimated, and
# with one held that was calibrated at 35.1 °C. Targets are known to 2 mm in the closed loop; tie
# points are good to 0.1 px in the open one. Published are 4.7 -> 3.2 and 6.2 -> 1.7 mm. Median of
# three draws, mm:

# %%
rows = {}
for times in TIMES:
    row = rows[f"{times} times, {0.075 * times:.3g} px a degree"] = {}
    for loop in LOOPS:
        for camera in HELD:
            found = STRONG.some([(times, loop, camera, d) for d in range(3)]).median()
            row[f"{loop}, {camera}"] = f"{found['raw']:.1f} -> {found['corrected']:.1f}"
print(STRONG.again(25, "open", "held", seed))
pd.DataFrame(rows).T

# %% [markdown]
# More than fifty times in the closed loop, some ten to thirty times in the open one. But ours is
# what the thesis measured. So it was not heat of this kind that the correction took out; what it
# was is not known.
#
# ## 3. The flight
#
# 77 pictures, two strips at 70 m over 500 m of road, 22.7 to 28.8 °C in a quarter of an hour. The
# camera was calibrated on the ground at 35.1 °C and is held; tie points are adjusted alone and the
# block is transformed onto ten ground points by a similarity. First without any noise.

# %%
road = perfect_block(replace(read_plan("thesis_road"), gnss=False), seed)
flying = road.column("images", "temperature_c").mean()


names = road.ground["point"]
warm_road = thermal.uncorrect(road, heat)[0]
parts = {
    "all of it": heat,
    "f alone": camlight(scale=slope_px / CAMLIGHT["f"], radial=0.0, shift=(0, 0)),
    "radial alone": camlight(scale=0.0, shift=(0, 0)),
    "shift alone": camlight(scale=0.0, radial=0.0),
}
rows = []
for name, part in parts.items():
    block = thermal.uncorrect(road, part)[0]
    temperatures = (35.1, flying, None)
    rows.append([name, *(on_the_road(block, names, part, t).mean() for t in temperatures)])
table = pd.DataFrame(
    rows, columns=["heat", "calibrated at 35.1 °C", "at the flight's mean", "corrected"]
)
print("mean residual (mm), no noise")
table.round(1)

# %% [markdown]
# It is the calibration's temperature that matters, not the six degrees of the flight. And it is the
# part of the heat that a similarity cannot absorb: the radial part, an eighty-fifth of a pixel a
# degree in the corner, does more than the focal length, which the similarity at the end takes back.
#
# Now with noise: tie points and marks 0.3 px, ground points 10 mm. The full radial part alone
# leaves as much as was published with all noise; we take half of it, **because** it then fits, so
# that the comparison with table 6.13 is no test (`tuned`).

# %%
half = camlight(scale=slope_px / CAMLIGHT["f"], radial=0.0117 / 2)
noise = {"tie_px": 0.3, "mark_px": 0.3, "control_m": 0.01}
warm_half = thermal.uncorrect(road, half)[0]
air = []
for d in seeds:
    noisy = add_noise(warm_half, **noise, seed=d)
    air.append([on_the_road(noisy, names, half, t) for t in (35.1, None)])
air = np.array(air)
mean = air.mean(axis=2)
gain = mean[:, 0] / mean[:, 1]
print(f"raw {mean[:, 0].mean():.0f} mm, corrected {mean[:, 1].mean():.0f} mm")
print(f"gain {gain.mean():.1f}, from {gain.min():.1f} to {gain.max():.1f} over {len(gain)} draws")

# %%
budget = {
    "calibration 10 °C away": (warm_half, 35.1, {}),
    "drift in flight": (warm_half, flying, {}),
}
for name, one in (("tie points", "tie_px"), ("marks", "mark_px"), ("ground points", "control_m")):
    budget[name] = (warm_half, None, {one: noise[one]})
rows = {}
for name, (block, at, one) in budget.items():
    noisy = [add_noise(block, **one, seed=d) if one else block for d in (seeds if one else [seed])]
    rows[name] = np.mean([on_the_road(b, names, half, at).mean() for b in noisy])
pd.DataFrame({"mean residual (mm)": rows}).round(1)

# %% [markdown]
# The published 21.4 and 15.5 mm are within what such a flight can show. But a gain of 1.4 needs the
# calibration 10 °C away *and* a part that no similarity absorbs, and one draw can as well show
# none. Where on the ground? The median draw, raw and corrected:

# %%
middle = np.argsort(mean[:, 0])[len(mean) // 2]
drawings.ground_residuals(
    {
        words: (road, values)
        for words, values in zip(("calibrated at 35.1 °C", "corrected"), air[middle], strict=True)
    },
    "residuals at the ten ground points: the correction shortens most of them",
)

# %% [markdown]
# ### What GNSS at the camera changes
#
# With antenna positions nothing takes the error back afterwards. Let the camera warm by
# 25 °C on its way.

# %%
hot = perfect_block(read_plan("thesis_road"), seed)
felt = hot.column("images", "temperature_c")
hot.images["temperature_c"] = 25 + 25 * (felt - felt.min()) / np.ptp(felt)
hot_seen = thermal.uncorrect(hot, heat)[0]


check = hot.ground["point"].tolist()
for metres in (0.01, 0.02):
    rows = []
    for d in seeds:
        noisy = add_noise(hot_seen, tie_px=0.3, mark_px=0.3, gnss_m=metres, seed=d)
        cold = thermal.correct(noisy, heat)[0]
        rows.append(
            [held_by_gnss(noisy, check, heat, 25.0), held_by_gnss(cold, check, heat, heat.t0_c)]
        )
    for title, (xy, z) in zip(("raw", "corrected"), np.median(rows, axis=0), strict=True):
        print(f"GNSS {100 * metres:.0f} cm, {title:9s}  horizontal {xy:.0f} mm   height {z:.0f} mm")

# %% [markdown]
# Here it matters, most where GNSS is good: at 2 cm the two strips, 16 m apart, leave the roll of
# the block open to 20 mm on the ground, whatever the camera does. Could the flight have found the
# slope by itself, without a laboratory?

# %%
for title, block in (("6 degrees", warm_road), ("25 degrees", hot_seen)):
    noisy = add_noise(block, tie_px=0.3, mark_px=0.3, seed=seed)
    noisy.gnss = noisy.gnss[:0]
    known = thermal.calibrated_at(
        noisy, heat, float(np.mean(noisy.column("images", "temperature_c")))
    )
    own = corridor.adjust(known, camera="fixed", effects=["thermal"], control=[])
    sigma = own.effects.set_index("parameter")["sigma"]["scale"] * CAMLIGHT["f"] / 2559.5
    print(f"{title:10s}: the slope of f is known to {sigma:.1f} px/C (it is {slope_px})")

# %% [markdown]
# No. The slope has to come from the laboratory, as a prior:

# %%
prior = thermal.laboratory_prior(heat, hot)
pd.DataFrame(prior, index=["value (px/C)", "sigma (px/C)"]).T.round(4)

# %% [markdown]
# `corridor correct BLOCK --effect thermal --model MODEL.json -o BLOCK2` takes it out of a block's
# tie points and marks, for any other program to go on.
#
# ### Does a calibration at close range hold in the air?
#
# The thesis asks it in its outlook (eq. 6.5, 6.6) and leaves it open: a lens focused at infinity
# may grow otherwise than one focused at a wall. A slope that is a tenth wrong leaves a tenth of the
# heat:

# %%
near = camlight(scale=1.1 * slope_px / CAMLIGHT["f"], radial=1.1 * 0.0117)
for words, model in (("the slope of the air", heat), ("a slope a tenth too large", near)):
    left_over = on_the_road(thermal.correct(warm_road, model)[0], names, heat, heat.t0_c).mean()
    print(f"corrected with {words}: {left_over:.1f} mm left, no noise")

# %% [markdown]
# ## Try it
#
# A short flight: how far the camera warms, how far away it was calibrated, how much of the heat is
# radial, how good tie points are.


# %%
plan = read_plan("thesis_road")
short = replace(
    plan, axis_m=((0.0, 0.0), (0.0, 150.0)), gnss=False,
    flights=(replace(plan.flights[0], images=26),),
    tie_points=replace(plan.tie_points, per_image=120),
)  # fmt: skip
short = perfect_block(short, seed)


def try_it(span=6.0, offset=10.0, radial=0.012, noise_px=0.1):
    """Residuals at the ground points, raw and corrected."""
    block = short.copy()
    felt = block.column("images", "temperature_c")
    block.images["temperature_c"] = 25 + span * (felt - felt.min()) / np.ptp(felt)
    model = camlight(scale=slope_px / CAMLIGHT["f"], radial=radial)
    seen = add_noise(
        thermal.uncorrect(block, model)[0], tie_px=noise_px, mark_px=noise_px, control_m=0.005,
        seed=seed,
    )  # fmt: skip
    at = 25 + span / 2 + offset
    names = block.ground["point"]
    return drawings.ground_residuals(
        {
            f"calibrated at {at:.0f} °C": (block, on_the_road(seen, names, model, at)),
            "corrected": (block, on_the_road(seen, names, model)),
        },
        "your flight: residuals at the ground points",
    )


# %% tags=["nbval-ignore-output"]
from kit.widgets import explore, slider

explore(
    try_it,
    span=slider("warms by (°C)", 0.5, 25.0, 6.0, 0.5),
    offset=slider("calibrated so far away (°C)", -15.0, 15.0, 10.0, 1.0),
    radial=slider("radial part (px/°C, corner)", 0.0, 0.02, 0.012, 0.001, readout_format=".3f"),
    noise_px=slider("tie points (px)", 0.0, 1.0, 0.1, 0.05),
)

# %% [markdown]
# ## Verdicts


# %%
def pair(tie, closed):
    """Raw, corrected and gain of the pylon, one row a draw."""
    found = found_at[tie, closed][:, :, 0 if closed else 1]
    return np.column_stack([found, found[:, 0] / found[:, 1]])


ring, opened = pair(0.3, True), pair(0.3, False)
ours = {
    "thermal.comparison.mean": differences[1.6, slope_px].mean,
    "thermal.comparison.border": differences[1.6, slope_px].side,
    "thermal.comparison.mean_10": differences[10.3, slope_px].mean,
    "thermal.comparison.border_10": differences[10.3, slope_px].side,
    "thermal.pylon.original": Draws(ring[:, 0]),
    "thermal.pylon.corrected": Draws(ring[:, 1]),
    "thermal.pylon.gain": Draws(ring[:, 2]),
    "thermal.closing.original": Draws(opened[:, 0]),
    "thermal.closing.corrected": Draws(opened[:, 1]),
    "thermal.closing.gain": Draws(opened[:, 2]),
    "thermal.aerial.original": Draws(mean[:, 0]),
    "thermal.aerial.original_std": Draws(air[:, 0].std(axis=1, ddof=1)),
    "thermal.aerial.corrected": Draws(mean[:, 1]),
    "thermal.aerial.corrected_std": Draws(air[:, 1].std(axis=1, ddof=1)),
    "thermal.aerial.gain": Draws(gain),
}
compare(ours)

# %% [markdown]
# ## What to take home
#
# - Calibrate at the temperature at which you fly. Then a similarity at the end leaves the heat
#   below the noise.
# - With GNSS at the camera and a camera that warms by tens of degrees: correct, or lose
#   centimetres horizontally.
# - The flight itself does not find the slope. The laboratory does (`03_thermal`).
