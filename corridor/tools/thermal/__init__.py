"""Thermal effect: deformation maps from pictures of a wall, the model of them, its correction.

maps = corridor.thermal.measure_maps("SERIES")
model = corridor.thermal.fit(maps).model
block, notes = corridor.thermal.correct(corridor.read("BLOCK"), model)
"""

from corridor.core.registry import offered
from corridor.tools.thermal.comparison import (
    CameraDifference,
    calibrated_at,
    camera_at,
    compare_cameras,
)
from corridor.tools.thermal.correction import correct, laboratory_prior, uncorrect
from corridor.tools.thermal.fitting import Fit, fit
from corridor.tools.thermal.maps import Maps, forget, measure_maps, read_maps
from corridor.tools.thermal.matching import Match, Matcher
from corridor.tools.thermal.model import ThermalModel, read_model, simple_model
from corridor.tools.thermal.points import apply, write_points
from corridor.tools.thermal.series import read_picture
from corridor.tools.thermal.temperature import degrees, optics, smoothed

__all__ = offered(globals())
