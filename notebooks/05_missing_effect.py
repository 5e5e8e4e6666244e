# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
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
# # What is missing from my model?
#
# The adjustment has converged, the residuals look like noise, sigma naught is one. But the check
# points are off by seven centimetres. **What did the camera do that the model does not know?**
#
# An independent program made five flights and hid something in each. We find it, and then open the
# file in which the truth is sealed. Two real flights follow, and in the second something is hidden
# for you.
#
# You need to know what a bundle adjustment is, and what a check point is. Chapter 4 says what a
# rolling shutter does.
# *Run time on one core: about 6 minutes; in the fast form about 2 minutes.*

# %% tags=["parameters"]
fast = False  # fewer simulated counterparts and geometries, and no real flights
seed = 0

# %%
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from kit import bruno, drawings
from kit.published import Draws
from kit.published import compare as beside_published
from kit.real import DATA, slow_ones, special_plot, without_images
from kit.viabon import as_text

import corridor
from corridor import figures
from corridor.diagnosis import Closing, compare, confusability, counterparts
from corridor.simulation import read_plan

sealed = Path("../data_synthetic/stories")
count = 19 if fast else 39
ours = {}


def truth_of(name):
    """What is hidden in a block, and the check-point error of its twin without it."""
    return json.loads((sealed / f"{name}.truth.json").read_text())["effects"]


# %% [markdown]
# ## 1. How often is it right?
#
# You learn how far to trust the method. Known effects were put into parts of a *real* survey; other
# parts were left untouched. Guess: of effects that reach ten of their own standard deviations, how
# many are named? In how many untouched parts is something found?

# %%
record = json.loads(Path("../docs/guarantees.json").read_text())["flights"]
asked = {
    "untouched: something is said all the same": "untouched blocks of which something is said",
    "effects of any size: a wrong name": "wrong names beside hidden effects",
    "effects of any size: named": "named, effects",
    "effects of any size: in the set that is named": "in the set that is named, effects",
    "10 sigma and more: in the set that is named": "of 10 sigma: in the set that is named",
    "10 sigma, and the flight can separate it: named": (
        "of 10 sigma, which the flight can tell from all others: named"
    ),
    "... and the value is right": "of these with the right value",
    "wrong control points: named": "control blunders named",
}
drawings.rates(
    [(words, *drawings.rate_of(record[key])) for words, key in asked.items() if key in record],
    "on real noise: a strong effect is named, a weak one is missed, a wrong name is rare",
    "effects put into parts of a survey at Saraburi; the program's own record (docs/guarantees)",
)

# %% [markdown]
# "In the set" means: several causes that a flight cannot separate are named, and the true one is
# among them.
#
# Strong effects are named, weak ones are missed, and wrong names are rare.

# %% [markdown]
# ## 2. The levee: residuals that look like noise
#
# You learn why residuals do not show what is missing, and what does. Forty-five photographs of a
# levee, five control points. The model has a calibrated camera, a global shutter and one lever arm
# (from the camera to the GNSS antenna). (`cauchy:2` is a robust loss: beyond two sigmas an
# observation counts for less.)

# %%
levee = corridor.read(sealed / "levee")
believed = corridor.adjust(levee, loss="cauchy:2")
tie = believed.observations.loc["tie", "rms_px"]
print(f"sigma naught {believed.sigma0:.2f}, tie residuals {tie:.2f} px")
print(f"check points {1000 * believed.check_rms.d3:.0f} mm")

# %% [markdown]
# Guess first: is the cause in the camera, the GNSS or the ground? The residuals of the tie points
# in the image:

# %%
figures.residual_vectors(believed)

# %% [markdown]
# Little to see. Poses and points absorb most of what is missing, and spread the rest over all
# images. A residual says *how much* disagrees; it does not say *what is missing*. So we ask: **what
# would this very flight look like if the believed model were true?** We simulate it many times,
# with the same images, points, control and kind of noise, and adjust each of these *counterparts*
# like the measured flight. Every statistic then has a band.

# %%
before = compare(counterparts(believed, count=count, seed=seed))
print(f"{len(before.leaving)} of {len(before.statistics)} statistics leave their bands")

# %%
figures.counterpart(before)

# %% [markdown]
# Grey is the band of the counterparts, dark is the measurement. The first panel holds the
# *signatures*: how much of each physical effect the residuals contain. Several leave the band,
# because effects look alike. To name one, we ask how much more likely the data are with it than
# without it. The logarithm of that ratio is its *log evidence*: 3 is 20 times as likely. `diagnose`
# asks this of all effects together, adds the winner to the model, adjusts, and asks again. Which
# would you name?

# %%
levee_found = corridor.diagnose(levee, seed=seed)
print(levee_found.sentence)

# %%
levee_found

# %%
figures.evidence_bars(levee_found.evidence, levee_found.course.last.threshold, "levee")

# %% [markdown]
# It is the camera, although the error appears on the ground.
#
# The *gap* is one number for all statistics outside their bands: gap = sum (|z| - limit)^2 -
# chance. Here z is a statistic in standard deviations of the counterparts, limit is the edge of its
# band, and chance is what leaves the bands by chance. The gap is near zero where simulation and
# measurement agree. Before and after:

# %%
closing = Closing(*levee_found.beside(count)[:2])
print(closing)
figures.counterpart(closing.before, closing.after)

# %% [markdown]
# Now we open the sealed file. The block also has a twin: the same flight and noise, without the
# effect. A good model comes near the error of the twin; a millimetre or two below it is chance.


# %%
def floor_of(name, camera=None):
    """Check-point error of the twin, mm: what the noise alone leaves."""
    return (
        1000 * corridor.adjust(corridor.read(sealed / f"{name}_twin"), camera=camera).check_rms.d3
    )


def opened(name, found):
    """Truth beside what was found, a row a parameter."""
    rows = []
    for effect in truth_of(name):
        mine = next((e for e in found.effects if e["slug"] == effect["slug"]), None)
        for parameter in effect["parameters"]:
            ours = {} if mine is None else {p["name"]: p for p in mine["parameters"]}
            one = ours.get(parameter["name"], {"value": np.nan, "sigma": np.nan})
            rows.append(
                [
                    effect["slug"], parameter["name"], parameter["unit"], parameter["value"],
                    one["value"], one["sigma"], (one["value"] - parameter["value"]) / one["sigma"],
                ]
            )  # fmt: skip
    columns = ["hidden", "parameter", "unit", "true", "found", "sigma", "error / sigma"]
    return pd.DataFrame(rows, columns=columns).round(4)


opened("levee", levee_found)

# %%
gap = {k: 1000 * v for k, v in levee_found.gap["check_m"].items()}
floor = floor_of("levee")
print(f"check points {gap['before']:.0f} mm before, {gap['after']:.0f} after, twin {floor:.0f}")
closed = (gap["before"] ** 2 - gap["after"] ** 2) / (gap["before"] ** 2 - floor**2)
print(f"closed: {100 * closed:.0f} % of what is not noise")

# %% [markdown]
# What the shutter did went into poses, points and ground. Residuals hardly show it, even those of
# observations kept out of the adjustment:

# %%
tie = levee_found.gap["tie_px"]
print(f"held-out tie observations: {tie['before']:.3f} px before, {tie['after']:.3f} px after")

# %% [markdown]
# ## 3. The towpath: two at once
#
# You learn how two missing effects are found. Each absorbs a part of the other, so the search adds,
# drops and swaps, and adjusts again in every round. Guess: if the stronger effect is named first,
# is its value right before the second one is in the model?

# %%
towpath = corridor.read(sealed / "towpath")
towpath_found = corridor.diagnose(towpath, seed=seed)
print(towpath_found.sentence)

# %%
pd.DataFrame(
    [
        [n + 1, ", ".join(one.log["model"]) or "as believed", slug, f"{evidence:.0f}"]
        for n, one in enumerate(towpath_found.course.rounds)
        for slug, evidence in one.log["found"].items()
    ],
    columns=["round", "model of the adjustment", "found", "log evidence"],
)

# %%
opened("towpath", towpath_found)

# %%
check = {k: 1000 * v for k, v in towpath_found.gap["check_m"].items()}
print(
    f"check points {check['before']:.0f} mm before, {check['after']:.0f} after, "
    f"twin {floor_of('towpath', 'fraser10'):.0f}"
)

# %% [markdown]
# Effects that absorb each other have to be estimated together.
#
# ## 4. The viaduct: the check points see nothing
#
# You learn whether good check points prove a good model. Here they are good to a centimetre, and
# the residuals are those of the first two flights. Guess: is anything missing?

# %%
viaduct = corridor.read(sealed / "viaduct")
viaduct_found = corridor.diagnose(viaduct, seed=seed)
print(viaduct_found.sentence)

# %%
opened("viaduct", viaduct_found)

# %% [markdown]
# The camera became warmer by 15 degrees, and its image plane with it. GNSS positions and control
# hold the ground in place; with less control it would be wrong (chapter 3). The scale is uncertain:
# a change of scale with temperature is nearly a change of height with time.
#
# Good check points do not prove a good model.

# %% [markdown]
# ## 5. The quay: GNSS and control contradict each other
#
# You learn what can be said when two sources disagree. The harbour's surveyor supplied the control,
# the base station was ours, and the check points are off by eight centimetres. Guess: can the
# program say who is wrong?

# %%
quay = corridor.read(sealed / "quay")
quay_found = corridor.diagnose(quay, seed=seed)
print(quay_found.sentence)

# %%
for effect in truth_of("quay"):
    values = ", ".join(f"{p['name']} {1000 * p['value']:.0f}" for p in effect["parameters"])
    print(f"hidden: {effect['slug']} {values} mm")

# %% [markdown]
# GNSS and control differ by one vector, and the flight knows nothing else. The program uses check
# points that were not surveyed with the control. It adds a common shift of the control, and says
# that the error of these points is no longer independent.
#
# Only a third source can say which of the two is right.

# %% [markdown]
# ## 6. The weir: something that no catalogue holds
#
# You learn what is said of a cause that has no name. Generic shapes compete with the named effects:
# camera parameters that follow time or temperature, motion of the ground, a smooth deformation of
# all pictures. When one wins, the answer is *unknown*, and *where*. Guess: will the program name
# *something*, because it has to?

# %%
weir = corridor.read(sealed / "weir")
weir_found = corridor.diagnose(weir, seed=seed)
print(weir_found.sentence)

# %% [markdown]
# The same bands, as maps over picture and ground. What poses and points absorb is in the band, so
# structure means disagreement:

# %%
weir_before, weir_after, _ = weir_found.beside(count)
figures.counterpart_maps(weir_before, weir_after)

# %%
(hidden,) = truth_of("weir")
(unknown,) = weir_found.unknown
x0, y0, x1, y1 = hidden["where"]["image"]
largest = hidden["parameters"][0]["value"]
print(f"hidden: a bump of up to {largest} px,")
print(f"  x = {x0:.0f} to {x1:.0f} px, y = {y0:.0f} to {y1:.0f} px")
print(f"found: {unknown['where']}")

# %% [markdown]
# The size found is an RMS over all pictures; the size of the bump is its largest value.
#
# A cause without a name still has a place and a size.

# %% [markdown]
# ## 7. Nothing missing is an answer too
#
# You learn what this answer is worth. The twin of the levee lacks nothing. Guess: what is the
# shortest readout that this flight would have shown, a millisecond, ten?

# %%
twin_found = corridor.diagnose(corridor.read(sealed / "levee_twin"), seed=seed)
print(twin_found.sentence)

# %%
units = {e.slug: {p.name: p for p in e.parameters(levee)} for e in corridor.catalogue()}
pd.DataFrame(
    [
        [slug, name, f"{limit:.3g}", units[slug][name].unit]
        for slug, limits in twin_found.detection_limits.items()
        for name, limit in limits.items()
        if limit is not None and name in units[slug]
    ],
    columns=["effect", "parameter", "smallest seen", "unit"],
).head(20)

# %% [markdown]
# "Nothing is missing" is worth as much as the smallest effect that would have been seen.
#
# ### Two answers that need no catalogue
#
# *All tests together*: if nothing is missing, how often is the strongest sign of all as strong by
# chance (p)? *Halves*: odd and even images, or strips, are adjusted apart; do their cameras and
# surfaces agree? Which of the two would you trust with the levee?

# %%
found_here = {
    "levee": levee_found, "towpath": towpath_found, "viaduct": viaduct_found,
    "quay": quay_found, "weir": weir_found, "levee's twin": twin_found,
}  # fmt: skip
pd.DataFrame(
    {
        name: {
            "all tests together, p": f"{one.p_nothing:.1e}",
            "halves, p": f"{one.halves.p:.2f}",
            "halves of": one.halves.by,
        }
        for name, one in found_here.items()
    }
).T

# %%
heights = {
    name: [row for row in one.halves.rows if row["name"].startswith("height")]
    for name, one in found_here.items()
    if name in ("levee", "levee's twin", "weir")
}
figures.curves(
    [
        figures.Panel(
            "", np.arange(1, 1 + len(next(iter(heights.values())))),
            {
                name: np.array([row["value"] / row["sigma"] for row in rows])
                for name, rows in heights.items()
            },
            "part of the corridor", "difference in height (sigmas)", zero=False,
        )
    ],
    "two halves of a flight agree, whatever is missing from both alike",
    "heights of the surface from odd and from even images or strips",
)  # fmt: skip

# %% [markdown]
# The first number finds every hidden effect here, and says nothing of the cause. The halves find
# none: an effect that bends both alike shows in neither. They find what changes from image to image
# or from strip to strip.

# %% [markdown]
# ## 8. What a flight cannot tell apart
#
# You learn to plan a flight that separates two effects. They are alike where one explains what the
# other does, after poses, points and camera have absorbed their share. Four ways to fly three
# strips over the dike, with a measured lever arm. Guess: which separates a late clock from a wrong
# arm?

# %%
plan = read_plan("../data_synthetic/dike.toml")
two_heights = replace(
    plan,
    flights=tuple(
        replace(flight, height_m=height)
        for flight, height in zip(plan.flights, ((40.0, 60.0), 50.0), strict=True)
    ),
)
ways = {
    "nadir, turned at each strip's end": plan,
    "heading kept": plan.with_flights(heading="kept"),
    "oblique, ahead and back": plan.with_flights(tilt_deg=25.0, look="alternating"),
    "two heights": two_heights,
}
if fast:
    ways = dict(list(ways.items())[:2])


def measured_arm(block):
    """The block with the lever arm that somebody measured, held."""
    block.lever_arm, block.lever_arm_fixed = {"default": (0.10, -0.05, 0.35)}, True
    return block


flown = {
    name: corridor.diagnose(measured_arm(corridor.simulate(way, seed=seed)), seed=seed)
    for name, way in ways.items()
}
alike = {name: confusability(one.course.last.evidence) for name, one in flown.items()}
first = next(iter(ways))
figures.alike(alike[first], first, least=0.3)

# %% [markdown]
# Dark off the diagonal: a pair that this flight cannot separate. Which pairs does each flight
# separate?

# %%
pairs = [
    ("clock_offset", "lever_arm"),
    ("rolling_shutter", "clock_offset"),
    ("focal_drift", "gnss_drift"),
    ("focal_drift", "focal_per_flight"),
    ("gnss_bias", "control_datum"),
]


def share(table, a, b):
    """How alike two effects are, %; nothing where the block does not show one of them."""
    if a not in table.index or b not in table.index:
        return "-"
    return f"{100 * max(table.loc[a, b], table.loc[b, a]):.0f} %"


pd.DataFrame(
    {name: [share(table, *pair) for pair in pairs] for name, table in alike.items()},
    index=[" / ".join(pair).replace("_", " ") for pair in pairs],
)

# %% [markdown]
# Where the drone turns with each strip, the arm turns with it, and a wrong arm looks like a late
# clock. A constant heading separates them. An oblique camera separates a drift of the focal length
# from one of the GNSS. A shutter is never taken for a clock. The last two pairs need another kind
# of data.
#
# The smallest effect that each flight would have seen:

# %%
shown = {
    ("rolling_shutter", "readout"): (1000, "ms"),
    ("clock_offset", "offset"): (1000, "ms"),
    ("focal_drift", "rate"): (600, "px / 10 min"),
    ("gnss_bias", "z"): (1000, "mm"),
    ("gnss_scale", "scale"): (1e6, "ppm"),
}
pd.DataFrame(
    {
        name: [
            "-" if (limit := one.detection_limits.get(slug, {}).get(parameter)) is None
            else f"{float(f'{factor * limit:.2g}'):,g} {unit}"
            for (slug, parameter), (factor, unit) in shown.items()
        ]
        for name, one in flown.items()
    },
    index=[f"{slug}, {parameter}".replace("_", " ") for slug, parameter in shown],
)  # fmt: skip

# %% [markdown]
# The flight plan decides what can be separated, before anything is measured.
#
# ## 9. A real flight: two causes named, one is not
#
# You learn how to test a diagnosis where nobody has the truth. A Phantom 4 took seventy-six
# photographs over a small plot. A published list, which the diagnosis has not seen, gives it a
# readout of 33 ms. Guess: what is missing, and will all statistics be in their bands afterwards?
# (Where the real blocks are missing, these cells say so.)

# %% tags=["nbval-ignore-output", "night"]
special = None if fast else special_plot()
if special is not None:
    named = corridor.diagnose(special, seed=seed)
    print(named.sentence)
    special_closing = Closing(*named.beside(count)[:2])
    print(special_closing)
    picture = figures.counterpart(special_closing.before, special_closing.after)
else:
    print("special_plot: not here")
    picture = None
picture

# %% [markdown]
# The gap shrinks, and it does not close: many statistics stay outside, where a twentieth would by
# chance. Now compare a number that the diagnosis has not used: the focal length of the data sheet.
# Guess: does each named cause bring the estimate nearer?

# %% tags=["nbval-ignore-output", "night"]
if special is not None:
    chosen = {"camera": "fraser8", "lever_arm": "fixed", "loss": "huber:2"}
    two = ["rolling_shutter", "clock_offset"]
    # Unevenness looks like radial distortion: of half a pixel, as `sensor_unflatness` expects it.
    effect = corridor.effects.find("sensor_unflatness")
    uneven = {f"{effect.slug}.{p.name}": (0.0, p.scale) for p in effect.parameters(special)}
    tried = {
        "as believed": {},
        "with shutter and clock": {"effects": two},
        "... and rotation": {"effects": [*two, "rolling_shutter_rotation"]},
        "... and an uneven sensor": {
            "effects": [*two, "rolling_shutter_rotation", "sensor_unflatness"],
            "priors": uneven,
        },
    }
    focal = {}
    for words, options in tried.items():
        found = (
            corridor.adjust(special, **(chosen | options)).camera.set_index("parameter").loc["f"]
        )
        focal[words] = found["value"], found["sigma"]
        print(f"f {found['value']:.0f} +- {found['sigma']:.0f} px  {words}")
    picture = drawings.intervals(
        focal, (1110, 1160), "f (px)",
        "what is named does not bring the focal length home; an uneven sensor does",
        "bars: stated sigmas; grey: nominal 3.61 mm of the Phantom 4",
    )  # fmt: skip
else:
    picture = None
picture

# %% tags=["nbval-ignore-output", "night"]
if special is not None:
    slow = slow_ones(special, 2.0)
    readouts = {}
    fast_ones = without_images(special, slow)
    for words, flight in (("all", special), (f"without {slow.sum()} slow ones", fast_ones)):
        found = corridor.adjust(flight, effects=["rolling_shutter"], **chosen).effects.iloc[0]
        readouts[words] = 1000 * found["value"], 1000 * found["sigma"]
        print(f"readout {1000 * found['value']:.1f} +- {1000 * found['sigma']:.1f} ms  {words}")
    picture = drawings.speeds_and_readout(
        special, slow, readouts, 33.0,
        "nine slow photographs at the strips' ends hold all that this flight knows of its readout",
    )  # fmt: skip
else:
    picture = None
picture

# %% [markdown]
# Shutter and clock, which are named, move the focal length away from the data sheet. A rotation
# during the readout only brings it back. With a sensor that is uneven by half a pixel it comes
# within little more than its sigma of the data sheet. The diagnosis sees that shape ("outside the
# catalogue") and gives no name: this flight cannot separate a sensor from a lens. Only nine
# photographs, where the drone nearly stood still, determine the readout.
#
# A gap that shrinks is no proof: test a cause with something that it was not fitted to, and say
# what contradicts it.

# %% [markdown]
# ## 10. Your turn: hide something in a real flight
#
# Compare yourself with the diagnosis. Eighty-eight photographs near Saraburi: two strips at 150 m,
# a *mechanical* shutter, RTK positions, one control point, two check points. First as they are:
# what is missing?

# %% tags=["nbval-ignore-output", "night"]
if not fast and (DATA / "saraburi" / "block").exists():
    saraburi = corridor.read(DATA / "saraburi" / "block")
    real = corridor.diagnose(saraburi, camera="fraser8", seed=seed)
    print(real.sentence)
    if real.lens:
        print(f"the lens beside its polynomials: {real.lens['rms_px']:.2f} px RMS, which moves the")
        print(f"ground by {1000 * real.lens['ground_m']:.0f} mm, ", end="")
        print(f"{real.lens['ground_sigmas']:.1f} of its sigmas")
    shutter = corridor.adjust(
        saraburi, camera="fraser8", effects=["rolling_shutter"], loss="huber:2"
    ).effects.iloc[0]
    print(
        f"readout, if asked for: {1000 * shutter['value']:.1f} +- {1000 * shutter['sigma']:.1f} ms"
    )
    ours["missing.saraburi.readout"] = 1000 * shutter["value"]
else:
    saraburi = None
    print("saraburi: not here")

# %% [markdown]
# The lens leaves some tenths of a pixel that no polynomial has, and moves the ground by less than
# the ground is known. The flight reveals no other cause.
#
# Now one effect is drawn by lot and put in: a drift of the focal length, a late clock, or a drift
# of the GNSS. Guess from the picture:

# %% tags=["nbval-ignore-output", "night"]
if saraburi is not None:
    lots = {
        "focal_drift": {"rate": 0.12}, "clock_offset": {"offset": 0.2}, "gnss_drift": {"z": 1e-3},
    }  # fmt: skip
    lot = list(lots)[int(np.random.default_rng([seed, 5]).integers(len(lots)))]
    settled = corridor.adjust(saraburi, camera="fraser8", loss="huber:2").block
    sealed_flight = corridor.effects.add(settled, {lot: lots[lot]})
    picture = figures.residuals_along(
        corridor.adjust(sealed_flight, camera="fraser8", loss="huber:2")
    )
else:
    picture = None
picture

# %% tags=["nbval-ignore-output", "night"]
if saraburi is not None:
    guessed = corridor.diagnose(sealed_flight, camera="fraser8", seed=seed)
    print(guessed.sentence)
    print(f"hidden: {lot} {lots[lot]}")

# %% [markdown]
# What the flight cannot separate is reported as a set; what is smaller than its noise is not
# reported.

# %% [markdown]
# ## What to take home
#
# - Ask what the same flight would look like if the model were true.
# - `corridor diagnose BLOCK -o OUT` asks it of every effect. It says *nothing*, *unknown, and
#   where*, one name, or several.
# - Plan the flight for what it has to separate: keep a heading, tilt the camera, or fly another
#   height.

# %% [markdown]
# ## Appendix: is a model of the shutter needed at all?
#
# Bruno and Forlani (2023) fly and simulate blocks with rolling shutters and conclude that mostly it
# is not: b1 and b2 of the extended camera absorb the affine deformation that a shutter causes. Is
# that so on a corridor? The dike again, with a readout of 25 ms, adjusted with b1 and b2 and
# without the shutter, and then with it: eight flights each, 3D RMS of the check points. Guess: does
# it matter whether the flight is even? (The draws are in `notebooks/draws`; one of each way is made
# again.)

# %%
rows = {}
for way in bruno.WAYS:
    both = bruno.TABLE.some([(way, draw) for draw in range(8)])
    ratio = (both["blind"] / both["aware"]).to_numpy()
    ours[f"missing.bruno.{way}"] = Draws(ratio[:, None])
    rows[way] = [as_text(both["blind"]), as_text(both["aware"]), as_text(ratio, 2)]
    print(bruno.TABLE.again(way, seed))
columns = ["b1, b2 only (mm)", "with the shutter (mm)", "ratio"]
pd.DataFrame.from_dict(rows, orient="index", columns=columns)

# %% [markdown]
# In an even flight (no wind, one speed, one attitude, no rotation during the readout) it is so: b1
# and b2 do as well. With the dike's wind, tilts and turns each image is deformed in another way,
# and b1 and b2 hold one deformation for all.
#
# ### Notes on the sections
#
# Simulated flights: they come from a program that shares no line of physics with this package. Its
# drone flies a continuous curve, its lens is not Fraser's, its noise has tails. The towpath's
# camera is calibrated by the flight itself; the viaduct was flown early in the morning.
#
# Section 2: the diagnosis has a robust loss of its own, so its "before" is not quite ours. A robust
# fit of so wrong a model converges slowly and is stopped before its end. Only the power of ten of
# the gap before counts; stopped elsewhere it was 2,600 to 8,500.
#
# Section 6: the estimated shape is smooth and the bump is not, so some statistics stay outside.
# Every lens leaves some deformation; it is reported only where it moves the ground or explains data
# that no fit has used much better.
#
# Section 7: all tests together treats many correlated tests as one (after Anau Montel, Alvey and
# Weniger 2024). Halves are compared with their joint covariance, as `mrcal` cross-validates a
# camera.
#
# Section 9: chapter 4's `readout flight` is the same adjustment, and finds the same readout within
# its sigma.

# %% [markdown]
# ## Verdict

# %% tags=["nbval-ignore-output"]
beside_published(ours)
