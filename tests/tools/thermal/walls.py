"""What the thermal tests share: a camera's heat, and maps as a perfect matcher would make them."""

import numpy as np
from kit.wall import Course, simulated_maps

from corridor.tools.thermal import simple_model


def camlight(width=5120, height=3840, radial=0.0117, shift=(-0.07, 0.27), bent=0.0, scale=13.7e-6):
    """The thesis's camera: f grows by 0.075 px/C (figure 6.8), its principal point as in table 8 of
    Daakir et al.; radial: px/C in the corner; bent: of the scale's growth by T^2, 1/C^2.
    """
    factor = width / 5120
    return simple_model(
        width, height, 24.0, (20.0, 55.0), scale=(scale, bent), radial=(radial * factor,),
        decentring=(0.0005 * factor,), shift=((shift[0] * factor, shift[1] * factor),),
    )  # fmt: skip


def mapped(course: Course, model, noise=0.0025, jump=None, shake=0.0, seed=0):
    """Maps without pictures. jump: row, x, y px: from there on the tripod stands elsewhere."""
    maps = simulated_maps(course, model, noise, shake, seed=seed)
    if jump:
        maps.dx[jump[0] :] += jump[1]
        maps.dy[jump[0] :] += jump[2]
    return maps


def warm_and_cool(count=70, lag_s=0.0, rounding_c=0.0, off_s=1000.0):
    """Temperatures up for 1000 s and down again."""
    return Course(np.linspace(0, 2000, count), off_s=off_s, lag_s=lag_s, rounding_c=rounding_c)


def off_by(found, true, temperature_c):
    """Shifts (rows, columns, 2) px of a fitted model less the true ones, both from found.t0_c."""
    x, y = np.meshgrid(np.linspace(0, true.width - 1, 17), np.linspace(0, true.height - 1, 13))
    wanted = np.stack(true.displacement(x, y, temperature_c), -1)
    wanted -= np.stack(true.displacement(x, y, found.t0_c), -1)
    return np.stack(found.displacement(x, y, temperature_c), -1) - wanted


def rms(values):
    """Root mean square of all that is not NaN."""
    return float(np.sqrt(np.nanmean(np.square(values))))
