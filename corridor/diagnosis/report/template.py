# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---
"""The report of `corridor diagnose`, a notebook in jupytext's percent format.

A heading stays on the page where the cell below it shows something.
"""

# %% tags=["parameters"]
# Set by corridor: the contents of a diagnosis, and the folder that the pictures go to.
contents = "contents.pickle"
pictures = "."

# %%
from corridor import figures
from corridor.diagnosis.report.notebook import Page

page = Page(contents, pictures)
page.opening()

# %% [markdown]
# ## The smallest effect that would have been seen
#
# 4.5 standard deviations, which are seen in nearly every block like this one. *Usual size* is one
# standard deviation of what cameras and flights are expected to have.

# %%
if page.nothing:
    page.table("limits")

# %% [markdown]
# ## Measured beside simulated
#
# The block was simulated again and again from the model that was believed in, with noise as large
# as its residuals show, and adjusted each time. Where the measured curve (dark) leaves the grey
# band, the model cannot have produced what was measured. The gap is the sum of all that sticks
# out, in squares of the counterparts' deviations; it has to shrink when the missing effect is
# added.

# %%
if page.before is not None:
    page.picture("measured_beside_simulated", figures.counterpart(page.before, page.after))

# %% [markdown]
# ## What was found

# %%
page.table("found")
page.table("unknown")

# %% [markdown]
# ## What would tell look-alikes apart

# %%
page.table("separating")

# %% [markdown]
# ## Data that the fit has not used
#
# Image points held out and check points have no say in the adjustment. *Noise alone* is what the
# simulated counterparts show, in which nothing is missing; *closed* is the share of the excess
# variance above it that is gone.

# %%
page.table("gap")

# %% [markdown]
# ## Statistics that leave their band

# %%
page.table("leaving")

# %% [markdown]
# ## Where
#
# The same comparison over the picture and over the ground, and below along every other axis that
# this block has. Every cell of a map says by how many standard
# deviations of the counterparts the measured value lies above or below them, so that what poses
# and points absorb is allowed for: cells that go together are disagreement, a patchwork is noise.

# %%
if page.before is not None:
    page.picture("where_maps", figures.counterpart_maps(page.before, page.after))
    page.picture("where_axes", figures.counterpart_axes(page.before, page.after))

# %% [markdown]
# ## Evidence of all candidates
#
# How much more likely the data are with each candidate than without it, as natural logarithm, each
# alone and beside what was found. A look-alike is tall alone and gone beside the right one.
# Generic shapes stand for what is not in the catalogue.

# %%
page.picture("evidence", figures.evidence_bars(page.evidence, page.threshold, page.name))

# %% [markdown]
# ## The smallest effect that would have been seen
#
# 4.5 standard deviations, which are seen in nearly every block like this one. *Usual size* is one
# standard deviation of what cameras and flights are expected to have.

# %%
if not page.nothing:
    page.table("limits")

# %% [markdown]
# ## What could not be tested

# %%
page.table("untestable")

# %% [markdown]
# ## Noise that is not the same everywhere

# %%
page.table("variance")

# %% [markdown]
# ## Known physics

# %%
page.table("physics")

# %% [markdown]
# ## The model that was believed in

# %%
page.table("believed")

# %% [markdown]
# ## The rounds of the search

# %%
page.table("rounds")

# %% [markdown]
# ## What was written beside this page

# %%
page.table("written")

# %% [markdown]
# ## How to make this page again

# %%
page.again()
