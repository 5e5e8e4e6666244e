"""The camera is held at a decentring distortion that is not the true one.

Source: Fraser 1997, "Digital camera self-calibration", in normalised units.
"""

from corridor.core.effects.contract import LinearEffect, Parameter, edge_of, of_interior


class DecentringDistortion(LinearEffect):
    slug = "decentring_distortion"
    title = "Decentring distortion that differs from the stated one (true minus stated)"
    called = "a correction of the stated decentring distortion"
    place = "camera"
    group = "camera"
    stands_in_for = ("p1", "p2")
    revealed_by = "images of several headings over the same ground, with GNSS or control"
    unobservable_when = "one heading and a free principal point: it is nearly a small tilt"

    def parameters(self, block):
        # 1 px at the end of the picture's long side, where p1 moves x by 3 f p1 u^2.
        f, edge = edge_of(block)
        return [Parameter(name, "1", scale=1.0 / (3.0 * f * edge**2)) for name in ("p1", "p2")]

    def derivative(self, context):
        """p1, p2 move by the values themselves."""
        return of_interior(context, p1=1.0, p2=1.0)
