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
# # My project is in another program: what does the diagnosis say of it?
#
# You have a project of COLMAP, OpenSfM or OpenDroneMap, Metashape, MicMac, Pix4D or an older
# program. **What did its camera do that its model does not know? And how do you go on in that
# program with corrected measurements?**
#
# Every format has conventions that are easily misread, and an import that misreads one looks like a
# bad camera. So the first question is: **was the project understood?** Every import is proved here.
# The imported points are projected with the imported poses and camera, and the result must agree
# with the observations.
#
# You need to know what a bundle adjustment is, and what distortion coefficients are.
# *Run time on one core: about 20 seconds; in the fast form about 20 seconds.*

# %% tags=["parameters"]
fast = False  # one kind of project in place of three
seed = 5
out = "../out/06_your_own_project"  # projects and blocks are written there

# %%
from pathlib import Path

import numpy as np
import pandas as pd
from kit.published import compare
from kit.real import DATA

import corridor
from corridor import interchange

out = Path(out)

# %% [markdown]
# ## A flight, and what another program makes of it
#
# The dike of the quickstart is flown with a rolling shutter of 30 ms. The other program knows no
# rolling shutter. It adjusts the block with eight camera parameters and saves its project. (Here
# `adjust` takes the place of that program, and we export its result.)

# %%
plan = "../data_synthetic/dike.toml"
flown = corridor.simulate(plan, {"rolling_shutter": {"readout": 0.030}}, seed=seed)
names = flown.tie_points["point"].cat.categories
flown = flown.select(points=[*names[::3], *flown.ground["point"]])
flown.images["time_s"] += 36000.0  # ten in the morning

blind = corridor.adjust(flown, camera="fraser8")
forms = ("colmap", "opensfm", "micmac", "metashape")
for form in forms:
    made = interchange.export_project(blind.block, form, out / form, lossy=True)
    print(made, end="\n\n")

# %% [markdown]
# ## Reading the project: is it proved?
#
# In a terminal: `corridor import auto PROJECT -o BLOCK`. The program recognises the format by its
# content.

# %%
rows = {}
for form in forms:
    project = interchange.read_project(out / form)
    proof = interchange.prove(project)
    block, main = project.block, proof.main
    rows[form] = {
        "images": len(block.images),
        "tie observations": len(block.tie_points),
        "marks": len(block.marks),
        "median px": round(main.median, 2),
        "RMS px": round(main.rms, 2),
        "verdict": proof.verdict,
    }
pd.DataFrame(rows).T

# %% [markdown]
# The project is now a block. What is in it, and where did the camera look?

# %%
corridor.figures.first_look(interchange.read_project(out / "colmap").block)

# %% [markdown]
# ## And if a convention had been taken the wrong way?
#
# Guess first: would you see an error of half a pixel in the origin, or p1 and p2 in the wrong
# order, where the residuals are half a pixel? We put each usual mistake into the good COLMAP
# project, and see what the proof says.

# %%
good = interchange.read_project(out / "colmap").block
quaternion = ["qw", "qx", "qy", "qz"]


def exchanged(block):
    for name, camera in block.cameras.items():
        block.cameras[name] = camera.with_values(p1=camera["p2"], p2=camera["p1"])


def half_a_pixel(block):
    block.tie_points[["x", "y"]] += 0.5


def transposed(block):
    block.images[quaternion[1:]] *= -1  # the inverse rotation


def upwards(block):
    height = next(iter(block.cameras.values())).height
    block.tie_points["y"] = height - 1 - block.tie_points["y"]


for mistake in (half_a_pixel, exchanged, transposed, upwards):
    wrong = good.copy()
    mistake(wrong)
    proof = interchange.prove(interchange.Project("colmap", out / "colmap", wrong))
    said = proof.explained[0] if proof.explained else "nothing"
    print(f"{mistake.__name__}: {proof.main.median:.2f} px median, {proof.verdict}\n   {said}\n")

# %% [markdown]
# The first two leave less than a pixel, which could pass for a mediocre camera. The proof names
# them all the same. The mean residual of an adjusted project is not half a pixel, and its own order
# of p1 and p2 fits better than any other.
#
# ## Real projects, by other authors
#
# They are not part of the project; where they are missing, this cell says so.

# %% tags=["nbval-ignore-output"]
data = DATA / "interchange"
real = (
    "colmap_sceaux", "opensfm_berlin", "photoscan_strasbourg", "micmac_saisies", "pix4d_p1",
    "bundler_balbianello", "nvm_sceaux", "photomodeler_strasbourg",
)  # fmt: skip
ours = dict.fromkeys(("interchange.photomodeler", "interchange.colmap", "interchange.micmac"))
if data.is_dir():
    rows = {}
    for name in real:
        project = interchange.read_project(data / name)
        proof = interchange.prove(project)
        rows[name] = {
            "format": project.form,
            "images": len(project.block.images),
            "observations": proof.main.count,
            "median px": round(proof.main.median, 2),
            "RMS px": round(proof.main.rms, 2),
            "verdict": proof.verdict,
        }
        if name == "photomodeler_strasbourg":
            kinds = proof.by_kind.values()
            square = sum(kind.count * kind.rms**2 for kind in kinds)
            ours["interchange.photomodeler"] = np.sqrt(square / sum(kind.count for kind in kinds))
        if name == "micmac_saisies":
            ours["interchange.micmac"] = proof.by_kind["pairs of the project itself"].rms
        if name == "colmap_sceaux":
            predicted = corridor.effects.predict(project.block).tie
            length = np.linalg.norm(project.block.tie_points[["x", "y"]] - predicted, axis=1)
            errors = pd.Series(length).groupby(project.block.tie_points["point"].to_numpy())
            ours["interchange.colmap"] = errors.mean().mean()
    print(pd.DataFrame(rows).T.to_string())
else:
    print("no real projects here: CORRIDOR_DATA names no folder")

# %% [markdown]
# ## From the project to a verdict
#
# COLMAP and MicMac store neither times nor antenna positions. These are in the log of the drone,
# and are joined by the names of the images. (With photographs: `--photos FOLDER`; with a receiver's
# track: `--track FILE`.) Then we ask the diagnosis: what is missing?

# %%
log = flown.images.set_index("image")[["time_s", "vx", "vy", "vz", "wx", "wy", "wz", "flight"]]
verdicts = {}
for form in ("colmap",) if fast else ("colmap", "opensfm", "micmac"):
    project = interchange.read_project(out / form)
    block = project.block
    block.images = block.images[["image", "camera", "x", "y", "z", *quaternion]].join(
        log, on="image"
    )
    block.gnss = flown.gnss
    block.sigma |= {"tie_px": 0.4, "mark_px": 0.4}
    block.write(out / f"{form}_block")
    diagnosis = corridor.diagnose(corridor.read(out / f"{form}_block"))
    verdicts[form] = diagnosis
    print(f"{form}:\n{diagnosis}\n")

# %% [markdown]
# ## And back: measurements that the other program understands
#
# The named effect is estimated together with the camera and taken out of the measurements. Then the
# project is written again. COLMAP has no b1, b2 and no shutter; the corrected export needs neither.
#
# `corridor adjust BLOCK --camera fraser10 --effect rolling_shutter -o OUT`, then `corridor export
# colmap OUT -o PROJECT --corrected`.

# %%
block = corridor.read(out / "colmap_block")
aware = corridor.adjust(block, camera="fraser10", effects=["rolling_shutter"])
aware.save(out / "result")
adjusted, effects = interchange.read_adjusted(out / "result")
try:
    interchange.export_project(adjusted, "colmap", out / "back", effects=effects)
except corridor.InputError as refusal:
    print(f"refused: {refusal}\n")
print(interchange.export_project(adjusted, "colmap", out / "back", effects=effects, corrected=True))

# %%
for name in ("colmap", "back"):
    print(f"{name}: {interchange.prove(interchange.read_project(out / name)).main}")

# %% [markdown]
# In the first project, poses and points had absorbed the shutter as far as they could. The
# corrected project fits its own camera to the noise of the measurements. This noise is 0.4 px an
# axis (0.57 px in length, less what poses and points absorb).
#
# ## What other programs printed, and what we find in their files

# %% tags=["nbval-ignore-output"]
compare(ours, absent="the project is not here")

# %% [markdown]
# ## What to take home
#
# - `corridor import auto PROJECT -o BLOCK`: the last lines are the proof. Above 2 px, or where a
#   usual mistake would explain the residuals, nothing is written.
# - An error of half a pixel in the origin moves the mean residual by half a pixel, and the proof
#   sees it. If it is in the camera and in the observations alike, it cancels and does no harm.
# - A project without observations (cameras and poses alone) is imported, and the program says that
#   it is not proved.
# - `corridor export FORMAT OUT -o PROJECT --corrected` is the way back.
