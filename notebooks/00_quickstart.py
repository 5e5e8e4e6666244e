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
# # From a folder of image measurements to points on the ground
#
# A drone has flown along a dike. A matching program has found tie points in its pictures, the
# GNSS receiver says where the antenna was at each exposure, and somebody has surveyed a few
# points on the ground. **How good are the points we get from all this, and is the report that
# says so right?**
#
# You need to know what a bundle adjustment is for, not how it works. The block is a folder of
# plain files; to see your own, change `block` below and run everything again. *Marks* are image
# measurements of surveyed ground points; *tie points* are seen in images and not surveyed.
# *Run time on one core: about 30 seconds; in the fast form about 20 seconds.*

# %% tags=["parameters"]
fast = False  # leave out the real blocks at the end
seed = 0  # of the poor start values in the appendix; nothing else is drawn at random
out = "../out/00_quickstart"  # where the results go
block = "../data_synthetic/dike"  # the folder of a block

# %%
import json
from pathlib import Path

import numpy as np
import pandas as pd
from kit import solvers
from kit.published import compare
from kit.real import DATA

import corridor

# %% [markdown]
# ## What is in the block?

# %%
flown = corridor.read(block)
flown.summary()

# %%
corridor.figures.first_look(flown)

# %% [markdown]
# ## Adjust it
#
# One call. It looks for poses, points, camera and lever arms at once, such that measured and
# modelled image points, antenna positions and control points agree best.
#
# Guess first. Each image point is measured to a fraction of a pixel, and a pixel is about a
# centimetre on the ground. Will the check points come out better horizontally or in height?

# %%
adjusted = corridor.adjust(flown)
adjusted

# %% [markdown]
# ## What does it come to on the ground?
#
# Check points took no part. What they are off by is the answer to the question; `sx, sy, sz` is
# what the adjustment itself promised.

# %%
adjusted.check_points.round(3)

# %% [markdown]
# Some are off by three times that. Is the report a liar? It says how well the *adjusted* point is
# known; the surveyed one has a sigma of its own (5 mm here, in block.toml), and the difference of
# the two has both:

# %%
survey = np.broadcast_to(flown.sigma["control_m"], 3)
checked = adjusted.check_points.set_index("point")
both = np.hypot(checked[["sx", "sy", "sz"]], survey).to_numpy()
off = checked[["dx", "dy", "dz"]] / both
print(
    f"{100 * (off.abs() < 1).to_numpy().mean():.0f} % of the differences within one sigma of both, "
    f"the largest at {off.abs().to_numpy().max():.1f}"
)
off.round(1)

# %%
rms, mean = adjusted.check_rms, adjusted.check_mean
print(f"RMS   horizontal {rms.xy:.3f} m   height {rms.z:.3f} m   3D {rms.d3:.3f} m")
print(f"mean  horizontal {mean.xy:.3f} m   height {mean.z:.3f} m")

# %% [markdown]
# In height, against what most expect: five control points and GNSS in every image hold the height
# of a block this short, and the horizontal error is made of two axes.

# %%
corridor.figures.check_points(adjusted)

# %% [markdown]
# ## Is something left in the images?
#
# If the camera model is right, residuals point anywhere. Arrows that follow their neighbours, or
# a trend along the corridor, are what the later chapters are about.

# %%
corridor.figures.residual_vectors(adjusted)

# %%
corridor.figures.residuals_along(adjusted)

# %% [markdown]
# Parameters that a block cannot tell apart stand out here: one can take the place of the other
# without the images noticing.

# %%
corridor.figures.correlation_matrix(adjusted)

# %% [markdown]
# ## Is the report right?
#
# The shipped block is simulated, so we may look behind the curtain: its true camera lies beside
# the folder. If the sigmas are honest, about two thirds of the estimates lie within one sigma of
# the truth and nearly all within three. (Of a real block nobody knows; the table stays empty.)

# %%
truth = Path(f"{block}.truth.json")
known = json.loads(truth.read_text(encoding="utf-8"))["camera"] if truth.exists() else {}
estimated = adjusted.camera[adjusted.camera.free]
rows = []
for row in estimated.itertuples():
    true = known.get(row.camera, {}).get(row.parameter)
    if true is not None:
        off = (row.value - true) / row.sigma
        rows.append(
            [row.parameter, f"{true:g}", f"{row.value:.6g}", f"{row.sigma:.2g}", f"{off:.1f}"]
        )
pd.DataFrame(rows, columns=["parameter", "true", "estimated", "sigma", "off by, in sigmas"])

# %% [markdown]
# ## Keep it
#
# The same as `corridor adjust BLOCK -o OUT`: `report.html` has everything above on one page, and
# `block/` can be read like the block we started from.

# %%
written = adjusted.save(out, corridor.figures.of_adjustment(adjusted))
print(*(path.name for path in written), sep="\n")

# %% [markdown]
# ## What if the camera did something the model does not know?
#
# Let the same flight be flown with a cheaper camera, whose shutter reads its rows one after the
# other in 30 ms. At 3 m/s the drone moves 9 cm meanwhile. Guess: how much of that reaches the
# ground points, with five control points holding the block?
#
# An effect is simulated, estimated and corrected by the same file; `corridor effects` lists them.

# %%
shaken = corridor.effects.add(adjusted.block, {"rolling_shutter": {"readout": 0.030}})
blind = corridor.adjust(shaken)
aware = corridor.adjust(shaken, effects=["rolling_shutter"])
corridor.figures.compare_check_points(blind, aware, labels=("shutter ignored", "shutter modelled"))

# %%
found = aware.effects.iloc[0]
print(f"check points 3D: {blind.check_rms.d3:.3f} m ignored, {aware.check_rms.d3:.3f} m modelled")
print(f"readout found: {1e3 * found.value:.1f} +- {1e3 * found.sigma:.1f} ms, put in: 30.0 ms")

# %% [markdown]
# Nearly half of the nine centimetres: five control points and a free camera take up the rest. With
# the shutter in the model it is as if there were none.
#
# ## Would others have found the same?
#
# A program that agrees with its own simulation proves little. Three real blocks have answers from
# elsewhere:
#
# - **Strasbourg**, five aerial photographs, adjusted and published with DBAT;
# - **Roma**, 60 photographs without any control, where the optimum was confirmed with COLMAP;
# - **Saraburi**, 88 drone images with GNSS, adjusted independently from the same files.
#
# They are not part of the project. Where they are (`CORRIDOR_DATA`, or `shared/data` beside the
# project), these cells adjust them; elsewhere they say so.

# %% tags=["nbval-ignore-output"]
ours = {}


def real(name):
    """A real block, or None where it is not to be had or the fast form was asked for."""
    if fast or not (DATA / name / "block.toml").exists():
        print(f"{name}: not here")
        return None
    return corridor.read(DATA / name)


# %% tags=["nbval-ignore-output"]
photographs = real("strasbourg")
if photographs:
    strasbourg = corridor.adjust(photographs, camera="fixed")
    image = pd.concat([strasbourg.residuals["tie"], strasbourg.residuals["mark"]])
    check = strasbourg.check_points[["dx", "dy", "dz"]]
    first = strasbourg.poses.set_index("image").loc["8811.jpg"]
    ours |= {
        "strasbourg.sigma0": strasbourg.sigma0,
        "strasbourg.redundancy": strasbourg.redundancy,
        "strasbourg.image_rms": np.sqrt(np.mean(image.vx**2 + image.vy**2)),
        "strasbourg.check_largest": check.abs().max(),
        "strasbourg.check_rms_3d": strasbourg.check_rms.d3,
        "strasbourg.photo_1.position": first[["x", "y", "z"]] + photographs.offset,
        "strasbourg.photo_1.position_sigma": first[["sx", "sy", "sz"]],
    }
    print(f"strasbourg: sigma0 {strasbourg.sigma0:.4f}")

# %% [markdown]
# Roma has no control and no GNSS: position, size and direction of the block are free, and nothing
# may pull at them. Distortion starts at zero. DBAT's own number for this block differs, and
# should: its polynomial corrects the measured point (image to ray), ours distorts the ray (ray to
# image). The same five parameters, two different curves.

# %% tags=["nbval-ignore-output"]
monument = real("roma")
if monument:
    roma = corridor.adjust(monument, camera="f,cx,cy,k1,k2")
    lens = roma.camera.set_index("parameter").value
    ours |= {
        "roma.optimum.sigma0": roma.sigma0,
        "roma.optimum.redundancy": roma.redundancy,
        "roma.optimum.f": lens["f"],
        "roma.optimum.principal_point": lens[["cx", "cy"]],
        "roma.optimum.k1": lens["k1"],
        "roma.optimum.k2": lens["k2"],
        "roma.richer.fraser8": corridor.adjust(monument, camera="fraser8").sigma0,
        "roma.dbat.sigma0": roma.sigma0,
        "roma.handed_down.sigma0": roma.sigma0,
    }
    print(f"roma: sigma0 {roma.sigma0:.5f} in {roma.iterations} iterations")

# %% [markdown]
# Saraburi is the drone flight. With one control point the heights are right. Guess what happens
# to focal length and heights without it: GNSS holds every camera to centimetres.

# %% tags=["nbval-ignore-output"]
drone = real("saraburi/block")
if drone:
    model = "f,cx,cy,k1,k2,p1,p2"
    one = corridor.adjust(drone, camera=model)
    points = one.check_points.set_index("point")[["dx", "dy", "dz"]]
    none = corridor.adjust(drone, camera=model, control=[], check=["GCP11", "GCP16", "GCP24"])
    # The source states its sigmas for unit weight, we scale them by sigma naught.
    loose = none.check_points.set_index("point")[["sx", "sy", "sz"]] / none.sigma0
    focal = {a: a.camera.set_index("parameter").loc["f"] for a in (one, none)}
    ours |= {
        "saraburi.gcp16.sigma0": one.sigma0,
        "saraburi.gcp16.f": focal[one].value,
        "saraburi.gcp16.tie_rms": one.observations.loc["tie", "rms_px"],
        "saraburi.gcp16.GCP11": points.loc["GCP11"],
        "saraburi.gcp16.GCP24": points.loc["GCP24"],
        "saraburi.no_control.f_sigma": focal[none].sigma / none.sigma0,
        "saraburi.no_control.height_sigma": loose.loc[["GCP11", "GCP16", "GCP24"], "sz"],
    }
    for title, a in (("GCP16 as control", one), ("no control", none)):
        print(
            f"{title}: f {focal[a].value:.0f} +- {focal[a].sigma:.0f} px, "
            f"height RMS {a.check_rms.z:.3f} m"
        )
    print(*none.warnings, sep="\n")

# %% [markdown]
# Both go astray together, the focal length by percents and the heights by metres, and all residuals
# stay small: GNSS holds the cameras, but a longer focal length over lower ground gives the same
# pictures. The report must say it itself, and does.
#
# ## Verdicts

# %% tags=["nbval-ignore-output"]
asked = [
    "strasbourg.sigma0",
    "strasbourg.redundancy",
    "strasbourg.image_rms",
    "strasbourg.check_largest",
    "strasbourg.check_rms_3d",
    "strasbourg.photo_1.position",
    "strasbourg.photo_1.position_sigma",
    "roma.optimum.sigma0",
    "roma.optimum.redundancy",
    "roma.optimum.f",
    "roma.optimum.principal_point",
    "roma.optimum.k1",
    "roma.optimum.k2",
    "roma.richer.fraser8",
    "roma.dbat.sigma0",
    "roma.handed_down.sigma0",
    "saraburi.gcp16.sigma0",
    "saraburi.gcp16.f",
    "saraburi.gcp16.tie_rms",
    "saraburi.gcp16.GCP11",
    "saraburi.gcp16.GCP24",
    "saraburi.no_control.f_sigma",
    "saraburi.no_control.height_sigma",
]
compare({name: ours.get(name) for name in asked}, absent="the real block is not on this machine")

# %% [markdown]
# ## What to take home
#
# - One call adjusts, one look at the check points says what it came to, and both their sigmas say
#   whether that was to be expected.
# - Residuals show that something is wrong, not what it does on the ground: a shutter of 30 ms hides
#   in them.
# - A program that says it is right should be asked by others' numbers.

# %% [markdown]
# ## Appendix: from a seed pair to the block
#
# Where do start values come from, if nobody knows a pose? From the images alone: the pair that
# shares most well-placed points is oriented relative to each other, its points are intersected,
# and the next image is resected from them, and so on, as Zhou (2019, 3.3.3) describes it for
# MicMac's Tapas. The dike without GNSS, poses and ground points, oriented so three times: as a mere
# chain, with what is there adjusted whenever it has grown by a quarter, and as a mere chain again
# with the lens of the adjustment above in place of none. Guess: what does a chain of 42 images
# lose, and to what?

# %%
shipped = corridor.read("../data_synthetic/dike")
dike = corridor.adjust(shipped).block
oriented = {
    "a mere chain": solvers.from_a_pair(solvers.unoriented(shipped), straightened=False),
    "adjusted on the way": solvers.from_a_pair(solvers.unoriented(shipped), straightened=True),
    "a mere chain, lens known": solvers.from_a_pair(solvers.unoriented(dike), straightened=False),
}
for words, made in oriented.items():
    start = solvers.off_by(made, dike)
    end = solvers.off_by(corridor.adjust(made).block, dike)
    rms = [1000 * np.sqrt(np.mean(values**2)) for values in (start, end)]
    print(f"cameras, {words}: off by {rms[0]:.0f} mm (RMS), adjusted by {rms[1]:.1f} mm")

# %%
order = np.arange(1, len(shipped.images) + 1)
corridor.figures.curves(
    [
        corridor.figures.Panel(
            "", order,
            {words: 100 * solvers.off_by(made, dike) for words, made in oriented.items()},
            "image, in the order of the flight", "camera off by (cm)",
        )
    ],
    "a chain of images bends where the lens is not known",
    "start values from a seed pair, after the best similarity",
)  # fmt: skip

# %% [markdown]
# Each resection passes what the lens does on to the points that the next one is made from. (Taken
# as undistorted, a lens tilts every image a little against its neighbour.) Adjusted, all three are
# the same block: start values only have to be near enough.
#
# ## Appendix: near enough for what?
#
# The adjustment walks downhill. How long a step? *Gauss and Newton* take the whole one; *Levenberg
# and Marquardt* shorten it where it went uphill; the *dog leg* follows the slope first and turns
# within a radius of trust; *conjugate gradients* find Marquardt's step without factorising a
# matrix, which very large blocks do not allow (the solvers that Zhou, 3.3.3, names). The dike
# again, from poses that are off by chance. Guess: which way fails first, and do those that arrive
# arrive at one place?

# %%
errors = {
    "0.3 m, 0.5 degrees": (0.3, 0.5), "1 m, 1 degree": (1.0, 1.0), "1 m, 2 degrees": (1.0, 2.0),
}  # fmt: skip
solvers.compared(dike, errors, seeds=2 if fast else 5)

# %%
start = solvers.displaced(dike, 1.0, 1.0, seed)
ways = {name: solvers.descend(start, way) for name, way in solvers.WAYS.items()}
least = min(way.costs[-1] for way in ways.values())
longest = max(way.steps for way in ways.values()) + 1
falling = {}
for name, way in ways.items():
    above = np.log10(np.maximum(np.array(way.costs) / least - 1, 1e-9))
    falling[name] = np.append(above, np.full(longest - len(above), np.nan))
corridor.figures.curves(
    [
        corridor.figures.Panel(
            "", np.arange(longest), falling, "step", "cost above the least (power of ten)",
            zero=False,
        )
    ],
    "near the solution a whole step squares the error, a tenth of one does not",
    "sum of squares over its least value, less one",
)  # fmt: skip

# %% [markdown]
# All that arrive arrive at one place. From far away the whole step overshoots; damping and the
# radius of trust pay there, and cost a few steps near by. Conjugate gradients need a thousand
# products for what one small factor does at once: with a corridor's narrow matrix a factor is
# cheap, and the package factorises. (Its own solver is Marquardt's with a damping that vanishes.)
