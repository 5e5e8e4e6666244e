"""The camera is held at a focal length that is not the true one.

Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
photogrammetry" (focal length against height in flat blocks).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, Variant, edge_of, of_interior

_PER_FLIGHT = Variant(
    slug="focal_per_flight",
    group="flight",
    title="Focal length of each flight (true minus stated)",
    called="a focal length of its own in each flight",
    revealed_by="flights over the same ground with GNSS or control, whose heights disagree",
    unobservable_when="each flight has its own free GNSS height and neither control nor obliques",
    about="""The focal length is another one in each flight: refocused, or the lens mounted anew.

    Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
    photogrammetry" (block-variant and photo-variant parameters).
    """,
)
_PER_IMAGE = Variant(
    slug="focal_per_image",
    group="image",
    title="Focal length of each image (true minus stated)",
    called="a focal length that changes from image to image",
    revealed_by="GNSS heights image by image, tilted images, or ground with relief",
    unobservable_when="images look straight down on flat ground without GNSS",
    about="""Every image has a focal length of its own: an autofocus that hunts, or what looks so.

    Source: this project (a shape for what no named effect explains).
    """,
    generic=True,
)


class Focal(LinearEffect):
    slug = "focal"
    title = "Focal length that differs from the stated one (true minus stated)"
    called = "a correction of the stated focal length"
    place = "camera"
    group = "camera"
    stands_in_for = ("f",)
    revealed_by = (
        "GNSS and ground control together, or two heights, or oblique images: scale and height "
        "then disagree"
    )
    unobservable_when = (
        "all images look straight down from one height and GNSS or control is absent"
    )
    variants = (_PER_FLIGHT, _PER_IMAGE)

    def parameters(self, block):
        if self.group == "image":
            return [Parameter("f", "px", scale=2.0)]
        # Twenty degrees between two flights change f by 3e-4 (Zhou 2019: 13.7e-6 a degree); a lens
        # that is refocused by hand by some times that.
        most = 1.5e-3 * edge_of(block)[0] if self.group == "flight" else np.inf
        return [Parameter("f", "px", scale=10.0, most=most)]

    def derivative(self, context):
        """f moves by the value itself."""
        return of_interior(context, f=1.0)
