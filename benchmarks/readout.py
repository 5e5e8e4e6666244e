"""How long a readout time takes to measure in photographs of 5472 x 3648 pixels.

python benchmarks/readout.py [--short] [--json FILE]

A star, a wheel and a LED; seconds on the clock and of processor, from photographs that have been
read to the result, beside the most that is asked for, and the error against the readout that was
rendered.
"""

import argparse
import json
import time
from pathlib import Path

from corridor.core.camera import Camera
from corridor.tools.readout import Photograph, measure_led, measure_star, measure_wheel, render

READOUT_S, TURNS, BLINKS = 0.04, 2.0, 700.0
MOST_S = {"star": 3.0, "wheel": 15.0, "led": 3.0}
FINISH = {"noise": 0.005, "blur_px": 0.8, "vignette": 0.3}


def photographs(size):
    """What each measurement takes: photographs, and turns or blinks a second."""
    width, height = size
    camera = Camera.from_table("made", {"width": width, "height": height, "f": 0.95 * width})
    shutter = render.Shutter(READOUT_S, 0.0006)
    # The camera is moved between the photographs, by some thousandths of the picture.
    still = render.View(camera, 1.2, 12.0, 40.0, (0.52 * width, 0.48 * height))
    moved = render.View(camera, 1.201, 12.0, 40.1, (0.523 * width, 0.479 * height))
    targets = {
        "star": (render.star, {"sectors": 24, "radius": 0.35}),
        "wheel": (render.wheel, {"spokes": 32, "crosses": 3, "radius": 0.32}),
    }
    found = {}
    for name, (draw, looks) in targets.items():
        pictures = (
            draw(still, shutter, 0.0, phase_deg=11.0, **looks),
            draw(moved, shutter, TURNS, phase_deg=77.0, **looks),
        )
        found[name] = [
            Photograph(f"{name} {k}", render.develop(one, seed=k, **FINISH))
            for k, one in enumerate(pictures)
        ] + [TURNS]
    lit = render.develop(render.led(camera, shutter, BLINKS), seed=3, **FINISH)
    found["led"] = [Photograph("led", lit), BLINKS]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--short", action="store_true", help="1368 x 912 pixels")
    parser.add_argument("--json", type=Path, help="write the figures to this file as well")
    options = parser.parse_args()
    size = (1368, 912) if options.short else (5472, 3648)
    measure = {"star": measure_star, "wheel": measure_wheel, "led": measure_led}
    figures = {"width": size[0], "height": size[1]}
    for name, given in photographs(size).items():
        clock, processor = time.perf_counter(), time.process_time()
        found = measure[name](*given)
        clock, processor = time.perf_counter() - clock, time.process_time() - processor
        percent = 100 * (found.readout_ms / (1e3 * READOUT_S) - 1)
        figures[name] = {"clock_s": clock, "processor_s": processor, "error_percent": percent}
        print(
            f"{name:6s} {clock:6.2f} s ({processor:.2f} s of processor; at most {MOST_S[name]:g} s "
            f"at 5472 x 3648), {percent:+.4f} % off",
            flush=True,
        )
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
