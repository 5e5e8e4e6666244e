"""Every image has a focal length of its own: an autofocus that hunts, or what looks like it.

Source: this project (a shape for what no named effect explains).
"""

from corridor.effects.catalogue.focal import Focal
from corridor.effects.contract import Parameter


class FocalPerImage(Focal):
    slug = "focal_per_image"
    title = "Focal length of each image (true minus stated)"
    called = "a focal length that changes from image to image"
    group = "image"
    refines = "focal"
    generic = True
    revealed_by = "GNSS heights image by image, tilted images, or ground with relief"
    unobservable_when = "images look straight down on flat ground without GNSS"

    def parameters(self, block):
        return [Parameter("f", "px", scale=2.0)]
