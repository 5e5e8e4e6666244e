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
# The adjustment has converged, the residuals look like noise, sigma naught is one. And the check
# points are off by seven centimetres. **What did the camera do that the model does not know?**
#
# This chapter takes three flights in which something is hidden, and finds it. They were made by a
# program that shares no line of physics with this package: its drone flies a continuous curve, its
# lens is not Fraser's, its noise has tails, and its truth lies sealed in a file beside the block
# that we open last. Then come real ones: a flight of which two causes are named and one is not,
# and one in which something is hidden for you. Chapter 5b is a game, and chapter 5c takes a
# published survey whose tables do not come out.
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
# Before you trust a method, ask for its record. Known effects were put into parts of a *real*
# survey (RTK positions, a mechanical shutter, tie points of another program), so that noise,
# outliers and lens are those of a real flight; other parts were left untouched. Guess: of effects
# that reach ten of their own standard deviations, how many are named? And of untouched parts, in
# how many is something found that is not there?

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
# A weak effect is missed; that is what sigmas are for. "In the set" means: the program says that
# the cause is one of several which this flight cannot separate, and the true one is among them.

# %% [markdown]
# ## 2. The levee: residuals that look like noise
#
# Forty-five photographs of a levee, a calibrated camera, a calm day, five control points. We
# believe in the camera of the calibration sheet, in a global shutter and in one lever arm.

# %%
levee = corridor.read(sealed / "levee")
believed = corridor.adjust(levee, loss="cauchy:2")
tie = believed.observations.loc["tie", "rms_px"]
print(f"sigma naught {believed.sigma0:.2f}, tie residuals {tie:.2f} px")
print(f"check points {1000 * believed.check_rms.d3:.0f} mm")

# %% [markdown]
# Guess first: is it the camera, the GNSS or the ground? (The answer comes below.) The residuals
# of the tie points, drawn in the image, are where everybody looks.

# %%
figures.residual_vectors(believed)

# %% [markdown]
# Little to see. Poses and points have had every chance to absorb what is missing, and what they
# cannot absorb they spread over all images. A residual says *how much* disagrees; it does not say
# *what should have been there*. So we ask the other way round: **what would this very flight look
# like if the believed model were true?** We simulate it, with the same images, points, gaps and
# control, and noise of the size and kind found in the block, adjust it as we adjusted the measured
# one, and do that many times. Every statistic then has a band, after absorption.

# %%
before = compare(counterparts(believed, count=count, seed=seed))
print(f"{len(before.leaving)} of {len(before.statistics)} statistics leave their bands")

# %%
figures.counterpart(before)

# %% [markdown]
# These simulated flights are the *counterparts*. Grey is what the believed model produces, dark is
# what was measured. The first panel holds the *signatures*, the physical effects of the catalogue:
# how much of each the residuals contain, allowing for absorption. Several leave the band, because
# several effects look alike. To name one needs more than a correlation: for each candidate, how
# much more likely are the data with it than without it? The logarithm of that ratio is its *log
# evidence*: 3 is 20 times as likely. `diagnose` asks that of all of them together, adds the winner
# to the model, adjusts again, and asks again. Which would you name? (Above, `cauchy:2` is a robust
# loss: beyond two sigmas an observation counts for less. The diagnosis has a loss of its own, so
# its "before" is not quite ours.)

# %%
levee_found = corridor.diagnose(levee, seed=seed)
print(levee_found.sentence)

# %%
levee_found

# %%
figures.evidence_bars(levee_found.evidence, levee_found.course.last.threshold, "levee")

# %% [markdown]
# So it was the camera: neither the GNSS nor the ground, although it was the ground that was off.
#
# Before and after, beside the simulated counterparts. How far all statistics together leave their
# bands is the *gap*: every value that sticks out of its band counts with the square of the excess,
# in standard deviations of the counterparts, less what sticks out by chance, gap = sum (|z| -
# limit)^2 - chance. It is near zero where simulation and measurement agree, and it has to shrink. A
# robust fit of so wrong a model creeps and is stopped before its end, so that only the power of ten
# of the gap before counts: stopped elsewhere it was 2,600 to 8,500.

# %%
closing = Closing(*levee_found.beside(count)[:2])
print(closing)
figures.counterpart(closing.before, closing.after)

# %% [markdown]
# Now we open the sealed file. It also has a twin of the block: the same flight, the same noise,
# no effect. What the adjustment of the twin leaves is noise: to come near it is all that a model
# can do. To come out a millimetre or two below it is luck, not skill.


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
# The residuals hardly moved: what the shutter did went into poses, points and ground.

# %%
tie = levee_found.gap["tie_px"]
print(f"held-out tie observations: {tie['before']:.3f} px before, {tie['after']:.3f} px after")

# %% [markdown]
# ## 3. The towpath: two at once
#
# A second flight, with a camera that is calibrated by the flight itself. Two things are missing.
# Adding one effect at a time and keeping the best misleads here: each takes up a part of the
# other. The search adds, drops and swaps, and every round starts from a new adjustment. Guess: if
# the stronger one is named first, is its value right before the second one is in the model?

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
# ## 4. The viaduct: the check points see nothing
#
# A third flight, early in the morning, on a single battery. Its check points are good to a
# centimetre, and the residuals are those of the first two flights. Guess: is anything missing?

# %%
viaduct = corridor.read(sealed / "viaduct")
viaduct_found = corridor.diagnose(viaduct, seed=seed)
print(viaduct_found.sentence)

# %%
opened("viaduct", viaduct_found)

# %% [markdown]
# The camera became warmer by 15 degrees, and its image plane with it. Good check points do not
# prove a good model: here the GNSS positions and the control hold the ground in place against the
# camera. A flight with less control would have paid for it (chapter 3). What is uncertain in the
# table is the scale: a change of scale with temperature is nearly a change of height with time.

# %% [markdown]
# ## 5. The quay: two witnesses, one of them wrong
#
# The control points came from the harbour's surveyor, the base station was our own. The check
# points are off by eight centimetres. Who is wrong? Guess what a program can say, and what it
# cannot.

# %%
quay = corridor.read(sealed / "quay")
quay_found = corridor.diagnose(quay, seed=seed)
print(quay_found.sentence)

# %%
for effect in truth_of("quay"):
    values = ", ".join(f"{p['name']} {1000 * p['value']:.0f}" for p in effect["parameters"])
    print(f"hidden: {effect['slug']} {values} mm")

# %% [markdown]
# The GNSS and the control contradict each other by one vector, and that is all that the flight
# knows. Which of the two is right is a question to a third witness: a point with published
# coordinates, a second base station, or, here, check points that were not surveyed with the
# control. The program asks them: it adds the common shift of the control, and says that the error
# of these check points is no longer independent.

# %% [markdown]
# ## 6. The weir: something that no catalogue holds
#
# Not everything has a name. Generic shapes compete beside the named effects: camera parameters that
# follow time or temperature, motion of the ground. When one of them wins, the honest answer is
# *unknown*, and *where*. A smooth deformation of all pictures is special: every lens leaves some of
# it, so it is estimated with everything else, and news only where it moves the ground or makes
# data that no fit has used much better. Guess: will a program name *something* here, because it
# has to name one?

# %%
weir = corridor.read(sealed / "weir")
weir_found = corridor.diagnose(weir, seed=seed)
print(weir_found.sentence)

# %% [markdown]
# The same bands as before, now as maps over the picture and the ground: what poses and points
# absorb is in the band, so that structure means disagreement.

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
# (The size in the sentence is an RMS over all pictures, after the poses have absorbed their share;
# the bump is its largest value. The shape that was estimated is smooth and the bump is not, so some
# statistics stay outside.)

# %% [markdown]
# ## 7. Nothing missing is an answer too
#
# The twin of the levee lacks nothing. Guess: what is the shortest readout that this flight would
# have shown, a millisecond, ten? The smallest effect that would have been seen is what one wants to
# know: it says what the flight can vouch for.

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
# ### Two answers that need no catalogue
#
# A catalogue holds what somebody has thought of. Two numbers ask without it. *All tests together*:
# if nothing is missing, how often does the strongest sign of all come out as strong by chance?
# (Many correlated tests as one, after Anau Montel, Alvey and Weniger 2024.) *Halves*: odd images
# against even ones, or strips, adjusted apart; the cameras and surfaces of the two are compared
# with their joint covariance, as `mrcal` cross-validates a camera. Which of the two would you trust
# with the levee?

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
# The first number finds them all, and says nothing of the cause. The halves are blind here: an
# effect that bends both halves alike shows in neither. They raise the alarm where an effect changes
# from image to image or from strip to strip, and that is when a catalogue is poorest.

# %% [markdown]
# ## 8. What a flight cannot tell apart
#
# Two effects are alike where, after poses, points and camera have taken their share, one explains
# what the other does. That is decided by the flight plan, before anything is measured. Four ways
# to fly the same three strips over the dike, with a lever arm that was measured and is held. Guess:
# which of them separates a late clock from a wrong lever arm?

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
# Dark off the diagonal: a pair that this flight leaves as a pair, and the diagnosis says so instead
# of choosing. Which pairs does each way of flying resolve?

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
# A clock that is late and an arm that is wrong are one where the drone turns with each strip, since
# the arm turns with it; a heading that is kept separates them. So does a camera that looks aside
# for a drift of the focal length and one of the GNSS. A shutter is never taken for a clock. None of
# these flights separates two of the pairs: what both flights share in time, and a shift of the GNSS
# and of all control. Those need another kind of data, not another flight.
#
# And the smallest effect that each would have seen:

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
# ## 9. A real flight: two causes named, one is not
#
# Seventy-six photographs of a Phantom 4 over a small plot, flown to and fro, its position by an
# ordinary GNSS, the speed of each exposure from the file's own header. Its camera is on a
# published list of readout times, with 33 ms. The diagnosis has not seen that list. Guess: what is
# missing, and will the picture be clean afterwards? (The real blocks are not part of the project;
# where they are not, these cells say so.)

# %% tags=["nbval-ignore-output"]
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
# The gap shrinks, and it does not close: many statistics stay outside their bands, where a
# twentieth would by chance. Two causes are named. Is the model right now? Ask a number that the
# diagnosis has not used: the focal length, which the data sheet knows. Guess: does each named cause
# bring it nearer?

# %% tags=["nbval-ignore-output"]
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

# %% tags=["nbval-ignore-output"]
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
# With shutter and clock, which are named, the focal length even moves away from the data sheet; a
# rotation while the rows are read only brings it back. With a sensor that is uneven by half a pixel
# it arrives, within little more than its sigma. The diagnosis sees that shape too ("outside the
# catalogue"), and rightly does not call it a cause: nothing in this flight separates a sensor from
# a lens.
#
# And all that this flight knows of its readout it knows from nine photographs at the ends of the
# strips, where the drone stood nearly still. (Chapter 4's `readout flight` finds the same within
# its sigma: it is the same adjustment, and it also leaves out whole strips to see how the result
# wanders.)

# %% [markdown]
# ## 10. Your turn: hide something in a real flight
#
# Eighty-eight photographs near Saraburi, two strips at 150 m, a camera with a *mechanical* shutter,
# RTK positions, one control point and two check points. First as they are: what is missing there?

# %% tags=["nbval-ignore-output"]
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
# A lens leaves some tenths of a pixel that no polynomial has; it moves the ground by less than the
# ground is known, and the flight cannot reveal any other cause. Now something is put into the
# measurements, drawn by lot and not shown: a focal length that drifts as a camera does that warms
# up, a clock that is late, or antennas that drift. Everything else stays real. Guess from the
# picture; then read on.

# %% tags=["nbval-ignore-output"]
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

# %% tags=["nbval-ignore-output"]
if saraburi is not None:
    guessed = corridor.diagnose(sealed_flight, camera="fraser8", seed=seed)
    print(guessed.sentence)
    print(f"hidden: {lot} {lots[lot]}")

# %% [markdown]
# Compare your guess. What the flight cannot separate, it reports as a set; and what is smaller than
# its noise, not at all (section 1).

# %% [markdown]
# ## What to take home
#
# - Small residuals prove nothing: what is missing hides in poses, points and ground. Ask what the
#   same flight would look like if the model were true.
# - `corridor diagnose BLOCK -o OUT` asks it of every effect of the catalogue at once, and says
#   *nothing*, *unknown, and where*, or a pair, where the flight does not tell more.
# - What a flight can tell apart is decided before it is flown: keep a heading, tilt the camera, fly
#   another height, according to what you have to know.
# - "Nothing is missing" is worth as much as the smallest effect that would have been seen.
# - A gap that shrinks is no proof. Keep something back that the cause was not fitted to, and say
#   what contradicts it.

# %% [markdown]
# ## Appendix: is a model of the shutter needed at all?
#
# Bruno and Forlani (2023) fly and simulate blocks with rolling shutters and conclude that mostly it
# is not: the affine deformation that a shutter causes is taken up by b1 and b2 of the extended
# camera. Is that so on a corridor? The dike again, now with a readout of 25 ms, adjusted with b1
# and b2 and without the shutter, and then with it: eight flights each, 3D RMS of the check points.
# Guess: does it matter whether the flight is even? (The draws stand in `notebooks/draws`; one of
# each way is made again.)

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
# In an even flight (no wind, one speed, one attitude, a camera that does not turn while it is read)
# it is so: b1 and b2 do as well. In one with the dike's wind, tilts and turns each image is
# deformed in another way, and b1 and b2 hold one deformation for all.

# %% [markdown]
# ## Verdict

# %% tags=["nbval-ignore-output"]
beside_published(ours)
