"""The pixels are not square or their axes not at right angles, and the held camera ignores it.

Source: Fraser 1997, "Digital camera self-calibration" (in-plane distortion), in normalised units.
"""

from corridor.core.effects.contract import LinearEffect, Parameter, edge_of, of_interior


class AffineDistortion(LinearEffect):
    slug = "affine_distortion"
    title = "Affine distortion that differs from the stated one (true minus stated)"
    called = "a correction of the stated affine distortion"
    place = "camera"
    group = "camera"
    stands_in_for = ("b1", "b2")
    revealed_by = "strips that cross, or GNSS and control along and across the corridor"
    unobservable_when = (
        "all strips are parallel and neither GNSS nor control gives the scale across; a rolling "
        "shutter at constant speed looks the same"
    )

    def parameters(self, block):
        # 2 px at the end of the picture's long side.
        f, edge = edge_of(block)
        return [Parameter(name, "1", scale=2.0 / (f * edge)) for name in ("b1", "b2")]

    def derivative(self, context):
        """b1, b2 move by the values themselves."""
        return of_interior(context, b1=1.0, b2=1.0)
