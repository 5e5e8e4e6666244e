"""Pictures of blocks and adjustments, one style; each function returns a matplotlib Figure."""

from corridor.core.output import png
from corridor.core.registry import offered
from corridor.interface.figures._alike import alike
from corridor.interface.figures._camera_views import camera_views
from corridor.interface.figures._check_points import (
    check_points,
    check_points_moved,
    compare_check_points,
)
from corridor.interface.figures._counterpart import counterpart, counterpart_axes, counterpart_maps
from corridor.interface.figures._curves import Panel, curves, estimates
from corridor.interface.figures._error_maps import error_maps
from corridor.interface.figures._first_look import first_look
from corridor.interface.figures._flight_readout import flight_readout
from corridor.interface.figures._image_shift import image_shift
from corridor.interface.figures._precision import precision_maps
from corridor.interface.figures._residual_vectors import residual_vectors
from corridor.interface.figures._residuals_along import residuals_along
from corridor.interface.figures._track import antenna, track
from corridor.interface.figures.change import (
    change_map,
    change_maps,
    change_profile,
    detection_map,
    of_change,
    point_changes,
)
from corridor.interface.figures.correlation import correlation_matrix
from corridor.interface.figures.diagnosis import evidence_bars
from corridor.interface.figures.planning import accuracy_by_control, control_map
from corridor.interface.figures.readout import readout_picture
from corridor.interface.figures.report import of_adjustment
from corridor.interface.figures.thermal import (
    camera_difference,
    deformation_maps,
    thermal_parameters,
)

__all__ = offered(globals())
