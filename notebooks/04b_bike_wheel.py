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
# # A bicycle wheel, and how fast a camera reads its picture
#
# A phone does not take its picture at once. It reads one row of pixels after the other, and from
# the first row to the last some time passes: the **readout time**. Spin a wheel before it, and the
# straight spokes bend. **Can you read that time off one photograph?**
#
# You need to know what an angle is, and that speed is angle by time.
# *Run time on one core: about 60 seconds; in the fast form about 50 seconds.*

# %% tags=["parameters"]
fast = False  # this page has only one speed
seed = 0  # nothing is drawn at random

# %%
from kit import classroom, lesson

# %% [markdown]
# ## Guess first
#
# The wheel turns **clockwise**, the rows are read **from top to bottom**. On which side of the
# picture will the spokes stand further apart: on the left or on the right? And if it turns the
# other way?
#
# Decide, then look. Then take the readout time down to 1 ms: that is a good camera.

# %% tags=["nbval-ignore-output"]
classroom.wheel_page()

# %% [markdown]
# *Where nothing moves above, this page is not running: you see what was measured in the picture it
# starts with. Open the notebook in Jupyter; for a class, `python run.py lesson --class` serves the
# same page to every phone in the room.*
#
# <details><summary><b>Which side, and why?</b></summary>
# On the right. There the spokes of a clockwise wheel move down, as the rows do: by the time a
# row is read, the spoke has run ahead of it, and the next spoke is met late. On the left the spokes
# come up towards the rows, and are met early, close together. Turn the wheel the other way, or
# hold the phone upside down, and the sides change.
# </details>
#
# Three more to guess before you move a slider:
#
# 1. Twice the readout time at half the speed: does the picture change?
# 2. A longer exposure smears the spokes. Does it bend them more?
# 3. Let the rows be read from left to right, as in a phone held upright. Which side is it now?
#
# <details><summary><b>Answers</b></summary>
# <ol>
# <li>Hardly (exposure 0 shows it best). The spokes bend by the angle the wheel turns through while
# the picture is read, which is speed times time. So the picture alone cannot tell the two apart:
# <b>you must know the speed</b>, and if you have it wrong by one per cent, the readout time is
# wrong by one per cent.</li>
# <li>No. Every row is smeared about the same middle, and the middle is what is measured.</li>
# <li>The spokes are further apart where they move to the right, at the top of a clockwise
# wheel.</li>
# </ol></details>
#
# ## The number
#
# Compare a bent spoke with itself at rest. On each row it has turned a little further than on the
# row before, by the same angle each time. Plot that angle against the row: the points lie on a
# line, and its slope, times the number of rows less one, is the angle $\alpha$ the wheel turned
# through while the picture was read. Then
#
# $$\text{readout time} = \frac{\alpha}{\text{turns a second} \times 360°}$$
#
# By hand: at 2 turns a second the wheel makes 720° in a second. If you find 21.6°, the readout
# took 21.6 / 720 = 0.030 s. "Show how it was measured" above draws all of this for the picture you
# made. The computer is told the turns a second and the direction, never the readout time.

# %%
settings = [
    lesson.Setting(10, 3.0),
    lesson.Setting(20, 2.0, "ccw"),
    lesson.Setting(30, 2.0, exposure_ms=5.0),
    lesson.Setting(56, 1.0, row_direction="up"),
    lesson.Setting(80, 1.5, "ccw", row_direction="right"),
]
print("set (ms)  measured (ms)  set within two sigmas")
for setting in settings:
    found = lesson.measure(setting)
    inside = abs(found.readout_ms - setting.readout_ms) < 2 * found.sigma_ms
    print(f"{setting.readout_ms:8.0f}  {found.readout_ms:13.0f}  {'yes' if inside else 'no':>21}")

# %% [markdown]
# 56 ms is what a well-known survey drone takes. At 5 m/s it flies 28 cm while it reads one
# picture; what that does to a map is the fourth chapter.
#
# ## Your own photo
#
# The page above takes two photographs of your own wheel, one at rest and one turning, and the turns
# a second. Either you get a readout time with its standard error, or one sentence that says what is
# wrong with the photographs. If the direction of rotation is not known, the readout time is the
# same; only whether the rows run up or down stays open.
#
# Give the turns a second as well as you can: their error goes into the readout time one to one. A
# film of the wheel, made by another phone, tells them too: `corridor readout wheel --help`.
#
# ## What to take home
#
# - A camera that reads row after row bends what moves; how far tells its readout time.
# - What is seen is an angle. Time needs the speed as well, and is never better known than it.
# - A single number, measured once for a camera, is enough to take the effect out of its pictures
#   later.
