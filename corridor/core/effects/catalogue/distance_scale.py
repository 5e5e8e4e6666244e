"""All scale bars or tapes are too long, or too short, by one ratio (given over true, less one).

Bars calibrated at another temperature, or a tape that has stretched: steel grows by 11.5 ppm a
degree, aluminium by 23.

Source: Luhmann et al., "Close-range photogrammetry and 3D imaging", section 4.4.3.
"""

from corridor.core.effects.contract import LinearEffect, Parameter


class DistanceScale(LinearEffect):
    slug = "distance_scale"
    title = "Common scale error of all measured distances"
    called = "a common scale error of all measured distances"
    place = "distance"
    needs = ("distances.distance",)
    revealed_by = "control or GNSS, which give the block another scale than all distances together"
    unobservable_when = "distances alone give the block its scale"
    # Aluminium over twenty degrees.
    unknowns = [Parameter("scale", "ppm", scale=500.0)]

    def derivative(self, context):
        """The given distance is longer by a millionth of itself for each ppm."""
        return 1e-6 * context.length[:, None, None]
