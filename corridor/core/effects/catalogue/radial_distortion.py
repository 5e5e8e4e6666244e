"""The camera is held at a radial distortion that is not the true one.

Source: Fraser 1997, "Digital camera self-calibration", in normalised units.
"""

from corridor.core.effects.contract import LinearEffect, Parameter, Variant, edge_of, of_interior

_NAMES = ("k1", "k2", "k3")
_PER_FLIGHT = Variant(
    slug="radial_distortion_per_flight",
    group="flight",
    title="Radial distortion of each flight (true minus stated)",
    called="a radial distortion of its own in each flight",
    revealed_by="tie points in three images or more of each flight, over the whole picture",
    unobservable_when="points fill a small ring of the picture only; k1, k2, k3 look alike there",
    about="""The radial distortion is another one in each flight: another lens, zoom or focus.

    Source: Luhmann, Fraser and Maas 2016, "Sensor modelling and camera calibration for close-range
    photogrammetry" (block-variant and photo-variant parameters).
    """,
)


class RadialDistortion(LinearEffect):
    slug = "radial_distortion"
    title = "Radial distortion that differs from the stated one (true minus stated)"
    called = "a correction of the stated radial distortion"
    place = "camera"
    group = "camera"
    stands_in_for = _NAMES
    revealed_by = (
        "tie points in three images or more: residuals point to the middle or away from it"
    )
    unobservable_when = "points fill a small ring of the picture only; k1, k2, k3 look alike there"
    variants = (_PER_FLIGHT,)

    def parameters(self, block):
        # 2 px at the end of the picture's long side from each of the three.
        f, edge = edge_of(block)
        return [
            Parameter(name, "1", scale=2.0 / (f * edge ** (2 * n + 3)))
            for n, name in enumerate(_NAMES)
        ]

    def derivative(self, context):
        """k1, k2, k3 move by the values themselves."""
        return of_interior(context, **dict.fromkeys(_NAMES, 1.0))
