"""The focal length is another one in each flight: refocused, or the lens mounted anew.

Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
photogrammetry" (block-variant and photo-variant parameters).
"""

from corridor.effects.catalogue.focal import Focal


class FocalPerFlight(Focal):
    slug = "focal_per_flight"
    title = "Focal length of each flight (true minus stated)"
    called = "a focal length of its own in each flight"
    group = "flight"
    refines = "focal"
    revealed_by = "flights over the same ground with GNSS or control, whose heights disagree"
    unobservable_when = "each flight has its own free GNSS height and neither control nor obliques"
