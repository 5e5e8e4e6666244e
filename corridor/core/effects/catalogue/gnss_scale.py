"""The GNSS positions have another scale than the ground: a map projection that nobody undid.

In a UTM zone's middle the map is 400 ppm too small, and 16 ppm more for 100 m of height.

Source: Snyder 1987, "Map projections - a working manual", chapter 8 (scale of the projection).
"""

from corridor.core.effects.contract import LinearEffect, Parameter


class GnssScale(LinearEffect):
    slug = "gnss_scale"
    title = "Scale of the GNSS positions (measured over true, minus 1)"
    called = "an error in the scale of the GNSS positions"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z")
    revealed_by = "ground control along the corridor, or a held focal length and known heights"
    unobservable_when = "no control and a free focal length: the whole block grows with its GNSS"
    unknowns = [Parameter("scale", "1", scale=300e-6, text="measured over true, minus 1")]

    def derivative(self, context):
        """The measured antenna moves by scale (C - M), M the middle of the stated centres."""
        return (context.centre - context.images.middle)[:, :, None]
