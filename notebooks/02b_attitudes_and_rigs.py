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
# # May a corridor be flown without control?
#
# A river in flood, a railway in use, a cliff: nobody can lay out targets. The drone knows where
# it was, to 2 cm horizontally and 4 cm in height. **Is that enough, and if not, what helps: a
# second height, an oblique strip, a better inertial unit, or a head of several cameras?**
#
# You need to know chapter 2: accuracy follows from the geometry, and check points tell whether it
# was reached. The antenna is held at its measured place here, and the camera calibrates itself.
# *Run time on one core: about 20 seconds; in the fast form about 20 seconds.*

# %% tags=["parameters"]
fast = False  # fewer draws
seed = 0

# %%
from dataclasses import replace

import numpy as np
import pandas as pd
from kit import drawings
from kit import uncontrolled as fly
from kit.published import compare
from kit.uncontrolled import AHEAD, BACK, LEFT, RIGHT, expected, flown, strips, with_head

from corridor.planning import GnssNoise, Planner
from corridor.simulation import read_plan

seeds = range(seed, seed + (8 if fast else 20))

# %% [markdown]
# ## 1. One strip
#
# One nadir strip of 300 m at 50 m, 44 images, no control. Guess before you read on: which of the
# three is worst, **across, along or height**, and is it centimetres or decimetres?
#
# *My guess:* ...

# %%
one = flown(strips("one", 1))
expected(one)[["x", "y", "z"]].round(1).rename("expected RMS (cm)").to_frame().T

# %% [markdown]
# Across (x): four decimetres. All antennas lie on a line, and a strip can roll about a line. Only
# the drone's own unrest, 30 cm to either side, holds it. The height follows, since the ground
# rolls with the camera.
#
# Roll is what an inertial unit measures. A gimbal knows its attitude to about 0.05 degrees, a
# unit for surveys to 0.003. At 50 m, 0.05 degrees are 4 cm. Guess what they leave of the four
# decimetres; and what a head leaves whose second camera looks 30 degrees ahead.
#
# *My guess:* ...

# %%
stated = {"sigma_m": 0.001, "sigma_deg": 0.02}
single = {
    "one strip": one,
    "attitudes to 0.05°": flown(strips("one", 1), attitude=0.05),
    "attitudes to 0.003°": flown(strips("one", 1), attitude=0.003),
    "head that looks ahead": with_head(one, 30.0, AHEAD, **stated),
}
pd.DataFrame({k: expected(p)[["x", "y", "z"]] for k, p in single.items()}).T.round(1)

# %% [markdown]
# (RMS in cm.) The gimbal takes half of it only: the mean of 44 measurements of 0.05 degrees is
# good to a hundredth of a degree, but nobody knows how the unit is turned against the camera.
# This **boresight** is estimated too, and along a single heading it looks like a roll of the
# ground. Only since the drone yaws and pitches by a degree or two are the two not quite the same,
# which is what the better unit sees. The head does not help at all: it rolls as a whole.
#
# ## 2. Two strips
#
# Back on a second strip, 20 m beside the first. The antennas span a plane, and the headings
# differ by 180 degrees: boresight and roll come apart. Now the question of the title. Put these
# in order of their **heights**, from worst to best:
#
# two nadir strips · with a third strip at 70 m · with a third strip that looks 25 degrees ahead ·
# with attitudes to 0.05 degrees · to 0.003 degrees · with a head of two cameras whose mounting is
# known to 1 mm and 0.02 degrees · whose mounting nobody knows
#
# *My guess:* ...

# %%
ways = fly.two_strips()
planned = {name: expected(plan) for name, plan in ways.items()}
drawn = {name: fly.TABLE.some([(name, fly.EVEN, s) for s in seeds]) for name in ways}
xyz = ["x", "y", "z"]
table = pd.DataFrame({name: found[xyz] for name, found in planned.items()}).T
for axis in xyz:
    table[f"{axis}, drawn"] = [np.sqrt(np.mean(d[axis] ** 2)) for d in drawn.values()]
print(fly.TABLE.again("two nadir strips", fly.EVEN, seed))
table.round(1)

# %%
drawings.expected_and_drawn(
    {name: found[xyz].to_numpy() for name, found in planned.items()},
    {name: found[xyz].to_numpy() for name, found in drawn.items()},
    "pictures that look ahead buy height, attitudes buy the direction across",
    f"check points of two strips at 50 m without control; {len(seeds)} simulated surveys a row",
)

# %%
ratios = [
    np.sqrt(np.mean(drawn[name][axis] ** 2)) / planned[name][axis] for name in ways for axis in xyz
]
print(f"drawn over expected: {min(ratios):.1f} to {max(ratios):.1f}, mean {np.mean(ratios):.1f}")

# %% [markdown]
# Read a row of dots before you trust one of them: a single survey of two nadir strips may be good
# to a centimetre by luck, or off by seven. Expectation and draws agree.
#
# Two lessons. **Oblique pictures buy height, attitudes do not.** The height hangs on the focal
# length: if it is wrong by 0.05 %, the ground is wrong by 0.05 % of 50 m. Only pictures that see
# the ground from different distances tell focal length from height, and an oblique picture does
# so by itself. **Attitudes buy the direction across**, where the roll of the block goes.
#
# The head buys the height without an extra strip, even if nobody knows how it hangs: its
# mounting is estimated from the pictures that both cameras took of the same ground.
#
# ### What nothing here buys
#
# Suppose that the base station's height is wrong by 5 cm. Guess which of the seven flights
# notices.
#
# *My guess:* ...

# %%
bias = pd.Series({name: found["bias"] for name, found in planned.items()})
print(f"cm in height for each cm of GNSS bias: {bias.min():.2f} to {bias.max():.2f}")

# %% [markdown]
# None. All of it goes to the ground, and no residual shows it. That is the price of flying
# without control, and one point pays it (chapter 2).
#
# ## 3. An oblique head, or another flight?
#
# The thesis (Zhou 2019, table 5.1) flies its dike twice, 315 nadir and 323 oblique pictures. A
# head takes both at once. What is it worth beside the second flight? The lever arm is free now,
# as in the thesis; the second pair of columns has the GNSS bias of chapter 2 (3, 1 and 7 cm).
# Guess whether one oblique camera will do, or whether it takes four.
#
# *My guess:* ...

# %%
thin = {"tie_points": replace(read_plan("thesis_s2_n50").tie_points, per_image=100)}
nadir, both = (
    replace(read_plan(name), **thin) for name in ("thesis_s2_n50", "thesis_s2_n50+thesis_s2_o50")
)
heads = {
    "nadir strips": nadir,
    "nadir and oblique strips": both,
    "head: ahead 25°": with_head(nadir, 25.0, AHEAD),
    "head: ahead and back 25°": with_head(nadir, 25.0, AHEAD, BACK),
    "head: four sides 45°": with_head(nadir, 45.0, AHEAD, BACK, LEFT, RIGHT),
}
rows = {}
for name, plan in heads.items():
    planner = Planner(plan, camera="fraser8", seed=seed)
    exposures = len(np.unique(planner.block.images["time_s"]))
    row = [exposures, len(planner.block.images), round(exposures * 2.5 / 60)]
    for noise in (GnssNoise(), GnssNoise(bias_m=(0.03, 0.01, 0.07))):
        planner.noise = noise
        row += [round(100 * planner.expect(n).z, 1) for n in (0, 1)]
    rows[name] = row
columns = ["exposures", "images", "minutes", "no control", "one point",
           "no control, bias", "one point, bias"]  # fmt: skip
print("expected RMS of heights, cm")
pd.DataFrame.from_dict(rows, orient="index", columns=columns)

# %% [markdown]
# One oblique camera is worth the second flight: half the time in the air for the same height.
# More of them add little to the *geometry*; they see façades. With the bias, all are alike
# without control, and one point helps all.
#
# ## 4. What others found
#
# **Štroner et al. (2021)** flew two sites at 100 m with an RTK drone and no control. From the
# abstract: heights off by up to several decimetres, linear in the error of the focal length; a
# nadir and an oblique flight together stay below 3 cm. So far our nadir strips were off by
# centimetres. Five strips at 100 m, RTK of 1.5 and 3 cm: noise alone, and with a lens that has
# half a pixel of deformation beyond its eight parameters. Guess: which of the two makes
# decimetres?
#
# *My guess:* ...

# %%
surveys = fly.five_strips()
lenses = range(seed, seed + (10 if fast else 30))
errors = ["f off (px)", "height off (cm)"]
found = {
    kind: {
        name: fly.TABLE.some([(name, kind, lens) for lens in lenses])[errors].to_numpy().T
        for name in surveys
    }
    for kind in (fly.EVEN, fly.UNEVEN)
}
print(fly.TABLE.again("nadir and 30° ahead", fly.UNEVEN, seed))
drawings.height_by_focal(
    found,
    -100 * 100.0 / fly.SMALL["f"],
    "an uneven lens makes decimetres of height, and an oblique flight takes most of them away",
    f"a mark a survey; {len(lenses)} lenses with half a pixel beyond eight parameters",
)

# %%
for kind, flights in found.items():
    for name, (_, height) in flights.items():
        median, largest = np.median(abs(height)), abs(height).max()
        print(f"{kind:18s} {name:19s} height off by {median:.1f} cm (median) to {largest:.1f} cm")

# %% [markdown]
# The lens. Noise never makes decimetres here. An oblique flight helps against either, but it is
# no insurance: the largest of these lenses still lifts the ground by more than 3 cm.
#
# **Two studies of corridors in the ISPRS Annals** calibrate the camera on the site, with a few
# oblique pictures (a *sub-block*), and carry it over to the nadir strips. From their abstracts:
# oblique pictures lower the correlation of focal length and ground height from 99 % to less than
# 20 % (X-3/W4-2025, 293), and height errors without control by up to 79 % (X-G-2025, 657). The
# same flights as above:

# %%
nadir, oblique = (fly.height_with_focal(surveys[name]) for name in surveys)
without, with_oblique = (expected(surveys[name])["z"] for name in surveys)
(f, height), (_, together) = found["and an uneven lens"].values()
compare(
    {
        "uncontrolled.stroner.nadir": abs(height).max() / 100,
        "uncontrolled.stroner.linear": np.corrcoef(f, height)[0, 1],
        "uncontrolled.stroner.oblique": np.median(abs(together)) / 100,
        "uncontrolled.sub_block.nadir": 100 * nadir,
        "uncontrolled.sub_block.oblique": 100 * oblique,
        "uncontrolled.sub_block.height": 100 * (1 - with_oblique / without),
    }
)

# %% [markdown]
# Two do not hold. Is it the lens that loosens height and focal length, or is it the flight? Their
# correlation over the draws, nadir, with the lens of one draw in all of them as well:

# %%
for kind in (fly.EVEN, fly.UNEVEN, fly.SAME):
    draws = fly.TABLE.some([("nadir", kind, d) for d in range(30 if kind != fly.SAME else 12)])
    print(f"{kind}: {np.corrcoef(draws[errors].to_numpy().T)[0, 1]:.2f} ({len(draws)} draws)")

# %% [markdown]
# One camera flown again and again, even or not, has the published line; of many cameras each moves
# the ground in its own way. And what would bring the 99 % between focal length and the height of a
# single point?

# %%
plan = surveys["nadir"]
noise = plan.noise
ways = {
    "as above": plan,
    "overlap of 90 %": plan.with_flights(forward=0.9),
    "GNSS three times as good": replace(
        plan, noise=replace(noise, gnss_m=tuple(np.array(noise.gnss_m) / 3))
    ),
    "pointing to 0.1 px": replace(plan, noise=replace(noise, tie_px=0.1, mark_px=0.1)),
    "twice as long": replace(plan, axis_m=((0.0, 0.0), (0.0, 600.0))),
    "two strips at 50 m": fly.two_strips()["two nadir strips"],
}
pd.Series({words: 100 * fly.height_with_focal(one) for words, one in ways.items()}).round(0)

# %% [markdown]
# Nothing of this. What the study correlated is not in its abstract.
#
# ## What to take home
#
# - Without control, fly two strips at least, in opposite directions; one strip rolls about its
#   antennas, and only attitudes of survey grade hold it.
# - For the height, let some pictures look obliquely: a strip or a head. One oblique camera is
#   enough.
# - Attitudes hold the direction across. They do not replace oblique pictures.
# - A lens that its model does not describe costs more than all noise together. Calibrate, and ask
#   the block (chapter 5).
# - A constant error of the GNSS goes to the ground in full. One control point, or one check
#   point, is worth more than everything on this page.
# - `corridor plan PLAN.toml --control 0,1 -o OUT` answers for your own flight, with
#   `attitudes = true` and `[rig.NAME]` in the plan.
