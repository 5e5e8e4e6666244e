"""What the static lessons need from the package: scenes, measured numbers, errors on the ground.

`python docs/lessons.py` measures the wheel at every position of its sliders and keeps the table
(docs/wheel_measured.json); the site's build reads it, and a test measures some of it again.
"""

import itertools
import json
import math
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
MEASURED = HERE / "wheel_measured.json"
sys.path.insert(0, str(HERE.parent / "notebooks"))

READOUT_MS = range(10, 65, 10)
TURNS = (1, 2, 3)
EXPOSURE_MS = (0.5, 4)


def positions():
    """Every position of the sliders: (key of the table, Setting)."""
    from kit.lesson import Setting

    for readout, turns, sense, exposure in itertools.product(
        READOUT_MS, TURNS, ("cw", "ccw"), EXPOSURE_MS
    ):
        yield (
            f"{readout:g} {turns:g} {sense} {exposure:g}",
            Setting(readout, turns, sense, exposure),
        )


def measured(setting):
    """Readout and its sigma, ms, as the package measures them; None where it cannot."""
    from kit.lesson import measure

    from corridor.core.errors import AdjustmentFailed

    try:
        found = measure(setting)
    except AdjustmentFailed:
        return None
    return [round(found.readout_ms, 3), round(found.sigma_ms, 3)]


def scene():
    """The page's wheel and camera as numbers, for docs/_static/wheel.js."""
    from kit import lesson

    from corridor.tools.readout import render

    view, wheel, camera = lesson._VIEW, lesson._WHEEL, lesson._CAMERA
    origin, axes = view.pose()
    ends, circles = render.Wheel(**wheel).parts()
    return {
        "width": camera.width,
        "height": camera.height,
        "focal": camera["f"],
        "centre": [float(camera["cx"]), float(camera["cy"])],
        "origin": origin.tolist(),
        "axes": axes.tolist(),
        "to_plane": np.linalg.inv(np.column_stack([axes[:, 0], axes[:, 1], origin])).tolist(),
        "ends": ends.tolist(),
        "circles": circles.tolist(),
        "bright": 0.7,
        "dark": 0.03,
        "background": 0.2,
        "phase": math.radians(20.0),
        "phase_at_rest": math.radians(5.0),
    }


# What the sliders of the second lesson set: effect, parameter, unit, its size in a unit, positions.
ERRORS = {
    "focal length stated wrong": ("focal", "f", "px", 1.0, range(-20, 21, 5)),
    "focal length that drifts": (
        "focal_drift",
        "rate",
        "px a minute",
        1 / 60,
        (-1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1),
    ),
    "rolling shutter": ("rolling_shutter", "readout", "ms", 1e-3, range(0, 61, 10)),
}


def on_the_ground():
    """Errors of check points, mm, at each position of the sliders; the camera is held as stated."""
    import effect_pages

    import corridor
    from corridor.core.effects import add

    block = corridor.simulate(effect_pages.PLAN)
    given = block.ground.set_index("point")
    out = {"errors": {}}
    for title, (slug, parameter, unit, size, positions) in ERRORS.items():
        rows = {}
        for at in positions:
            wrong = add(block, {slug: {parameter: at * size}})
            adjusted = corridor.adjust(wrong, camera="fixed", max_iterations=200, strict=True)
            check = adjusted.check_points
            rows[f"{at:g}"] = np.round(1e3 * check[["dx", "dy", "dz"]].to_numpy(float), 2).tolist()
            out["places"] = np.round(
                given.loc[check["point"], ["x", "y"]].to_numpy(float), 2
            ).tolist()
        out["errors"][title] = {
            "unit": unit,
            "positions": [float(at) for at in positions],
            "rows": rows,
        }
    return out


def main():
    """Measures the whole table."""
    table = {}
    for key, setting in positions():
        found = measured(setting)
        if found:
            table[key] = found
        print(key, found, flush=True)
    text = ",\n".join(f"{json.dumps(key)}: {json.dumps(row)}" for key, row in table.items())
    MEASURED.write_text(f"{{\n{text}\n}}\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
