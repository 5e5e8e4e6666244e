"""A page an effect: formula, data, and what it does, as figures made from the effect alone.

One perfect flight is measured as the effect says at its usual size, then adjusted as if it were not
there: what moves in a picture, and what comes out wrong on the ground.
"""

from pathlib import Path

import numpy as np
import pandas as pd

import corridor
from corridor.core.effects import Values, add, every_effect, predict
from corridor.core.geometry import vector_from_rotation
from corridor.core.simulation import ORDINARY_NOISE
from corridor.interface.figures import error_maps, image_shift

PLAN = Path(__file__).with_name("effect_flight.toml")
# For effects of cameras that hang together, and of distances.
OF_A_RIG = Path(__file__).with_name("effect_rig.toml")
# Places whose shifts a person would rather read than see in a picture.
WHERE = {
    "camera": "the camera: focal length, principal point, distortion of an image",
    "image": "the image point",
    "motion": "the camera during the readout of a picture",
    "antenna": "the antenna positions of GNSS",
    "attitude": "the measured attitudes",
    "ground": "the given coordinates of control points",
    "distance": "the measured distances",
}


def usual(effect, block):
    """Values of an effect at its usual size: the scale of one, draws of the scale of several."""
    given = Values.of(block, {effect.slug: {}})[effect.slug]
    scale = np.array([one.scale for one in given.parameters])
    draws = np.random.default_rng(0).standard_normal(given.value.shape)
    rows = scale * (draws if draws.size > 1 else np.ones_like(draws))
    return {
        one.name: dict(zip(given.groups, rows[:, k].tolist(), strict=True))
        if len(given.groups) > 1
        else float(rows[0, k])
        for k, one in enumerate(given.parameters)
    }


def make(folder: Path, progress=print) -> list[str]:
    """Writes SLUG.md and its figures for every effect of the catalogue; the slugs."""
    folder.mkdir(parents=True, exist_ok=True)
    blocks = [corridor.simulate(plan) for plan in (PLAN, OF_A_RIG)]
    noisy = corridor.simulate(PLAN, noise=ORDINARY_NOISE)
    alike = corridor.diagnosis.confusability(corridor.diagnose(noisy).course.last.evidence)
    slugs = []
    for effect in every_effect():
        progress(f"  {effect.slug}")
        block = next(block for block in blocks if not effect.missing(block))
        (folder / f"{effect.slug}.md").write_text(
            page(effect, block, alike, folder), encoding="utf-8", newline="\n"
        )
        slugs.append(effect.slug)
    return slugs


def page(effect, block, alike, folder):
    """Markdown of the page of one effect; its figures are written."""
    values = {effect.slug: usual(effect, block)}
    told = effect.described()
    lines = [f"# {effect.title}", "", f"`{effect.slug}` acts on {WHERE[effect.place]}.", ""]
    lines += [f"{text}\n" for text in told[:1]]
    lines += ["## What it does", ""]
    lines += pictures(effect, block, values, folder)
    lines += ["", "## What tells it, and what hides it", ""]
    lines += ["| | |", "|---|---|"]
    for title, text in (
        ("shown by", effect.revealed_by),
        ("hidden if", effect.unobservable_when),
        ("looks like", imitators(effect.slug, alike)),
        ("needs", ", ".join(f"`{one}`" for one in effect.needs) or "nothing but the images"),
        (
            "one set of values for",
            "the block" if effect.group == "block" else f"each {effect.group}",
        ),
        ("parameters", parameters(effect, block)),
    ):
        if text:
            lines.append(f"| {title} | {text} |")
    if len(told) > 1:
        lines += ["", "## Formula", "", *told[1:]]
    lines += [
        "", "## Use", "", "```", f"corridor adjust BLOCK --effect {effect.slug} -o OUT",
        f"corridor correct BLOCK --effect {effect.slug} -o BLOCK2", "```", "",
    ]  # fmt: skip
    return "\n".join(lines)


def imitators(slug, alike):
    """Effects that explain half of this one and more on the flight of these pages, with shares."""
    if slug not in alike.index:
        return ""
    shares = alike.loc[slug].drop(slug).sort_values(ascending=False)
    return ", ".join(
        f"[{other}]({other}.md) ({share:.0%} of it)"
        for other, share in shares[shares >= 0.5].items()
    )


def parameters(effect, block):
    """Names, units and usual sizes, of many the first and the last."""
    found = effect.form(block).parameters(block)
    if len(found) > 4:
        found = [found[0], found[-1]]
        return " to ".join(f"{one.name} ({one.unit}, usual size {one.scale:.3g})" for one in found)
    return ", ".join(f"{one.name} ({one.unit}, usual size {one.scale:.3g})" for one in found)


def pictures(effect, block, values, folder):
    """Markdown of the figures of an effect, which are written into the folder."""
    out = []
    moved = predict(block, values)
    still = predict(block)
    shown = np.nan_to_num(np.abs(moved.tie - still.tie)).max(axis=1) > 0
    moving = block.tie_points["image"][shown].unique()
    image = moving[len(moving) // 2] if len(moving) else block.images["image"].iloc[0]
    rows = block.tie_points["image"].to_numpy() == image
    xy = block.tie_points.loc[rows, ["x", "y"]].to_numpy()
    shift = (moved.tie - still.tie)[rows]
    camera = next(iter(block.cameras.values()))
    if np.nanmax(np.abs(shift)) > 0:
        table = pd.DataFrame(np.column_stack([xy, shift]), columns=["x", "y", "dx", "dy"])
        path = folder / f"{effect.slug}_picture.png"
        image_shift(
            table, camera.width, camera.height, "What moves in one picture",
            "tie points of a middle picture, at the usual size of the effect",
        ).savefig(path, dpi=100)  # fmt: skip
        out += [f"![Arrows: how the points of one picture move]({path.name})", ""]
    elif len(block.gnss) and np.nanmax(np.abs(moved.gnss - still.gnss)) > 0:
        size = 1e3 * np.sqrt(np.mean((moved.gnss - still.gnss) ** 2, axis=0))
        words = ", ".join(f"{one:.0f}" for one in size)
        out += [
            f"In the pictures nothing moves. The antenna moves by {words} mm in x, y, z (RMS).",
            "",
        ]
    elif not np.array_equal(moved.attitude, still.attitude):
        turn = moved.attitude @ still.attitude.transpose(0, 2, 1)
        size = np.degrees(np.sqrt(np.mean(vector_from_rotation(turn) ** 2, axis=0)))
        words = ", ".join(f"{one:.2f}" for one in size)
        out += [
            "In the pictures nothing moves. The measured attitudes turn by "
            f"{words} degrees about x, y, z of the camera (RMS).",
            "",
        ]
    else:
        what = "distances" if effect.place == "distance" else "coordinates"
        out += [f"In the pictures nothing moves: given {what} do.", ""]
    measured = add(block, values)
    try:
        adjusted = corridor.adjust(measured, max_iterations=200, strict=True)
    except corridor.AdjustmentFailed as reason:
        return [*out, f"Left out of the model, the adjustment fails: {reason}"]
    if not adjusted.converged:
        return [*out, "Left out of the model, the adjustment does not converge."]
    errors = adjusted.check_points
    given = block.ground.set_index("point").loc[errors["point"], ["x", "y"]].reset_index(drop=True)
    table = pd.concat([given, errors.reset_index(drop=True)[["dx", "dy", "dz"]]], axis=1)
    path = folder / f"{effect.slug}_ground.png"
    error_maps({"left out": table}, "What comes out wrong on the ground").savefig(path, dpi=100)
    out += [f"![Maps of the errors of check points, horizontal and height]({path.name})", ""]
    return out
