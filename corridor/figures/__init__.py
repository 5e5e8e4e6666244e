"""Pictures of blocks and adjustments, one style; each function returns a matplotlib Figure."""

from corridor.figures.alike import alike
from corridor.figures.camera_views import camera_views
from corridor.figures.change import (
    change_map,
    change_maps,
    change_profile,
    detection_map,
    of_change,
    point_changes,
)
from corridor.figures.check_points import check_points, check_points_moved, compare_check_points
from corridor.figures.correlation import correlation_matrix
from corridor.figures.counterpart import counterpart, counterpart_axes, counterpart_maps
from corridor.figures.curves import Panel, curves, histograms
from corridor.figures.diagnosis import evidence_bars
from corridor.figures.error_maps import error_maps
from corridor.figures.first_look import first_look
from corridor.figures.flight_readout import flight_readout
from corridor.figures.image_shift import image_shift
from corridor.figures.planning import accuracy_by_control, control_map
from corridor.figures.readout import readout_picture
from corridor.figures.report import of_adjustment, save_adjustment
from corridor.figures.residual_vectors import residual_vectors
from corridor.figures.residuals_along import residuals_along
from corridor.figures.thermal import camera_difference, deformation_maps, thermal_parameters
from corridor.figures.track import antenna, track
from corridor.report import png

__all__ = [
    "alike",
    "Panel",
    "accuracy_by_control",
    "antenna",
    "camera_difference",
    "camera_views",
    "change_map",
    "change_maps",
    "change_profile",
    "check_points",
    "check_points_moved",
    "compare_check_points",
    "control_map",
    "correlation_matrix",
    "counterpart",
    "counterpart_axes",
    "counterpart_maps",
    "curves",
    "deformation_maps",
    "detection_map",
    "error_maps",
    "evidence_bars",
    "first_look",
    "flight_readout",
    "histograms",
    "image_shift",
    "of_adjustment",
    "of_change",
    "point_changes",
    "png",
    "readout_picture",
    "residual_vectors",
    "residuals_along",
    "save_adjustment",
    "thermal_parameters",
    "track",
]


def __dir__():
    return sorted(__all__)
