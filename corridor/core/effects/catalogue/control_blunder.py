"""One ground control point was surveyed wrongly, or its mark has moved (given minus true).

Source: Baarda 1968, "A testing procedure for use in geodetic networks".
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, Variant

_OF_THE_BLOCK = Variant(
    slug="control_datum",
    group="block",
    title="Common shift of all ground control points",
    called="a common shift of all ground control",
    revealed_by="GNSS with known lever arms: all control points disagree with it by one vector",
    unobservable_when=(
        "there is no GNSS; a bias of the GNSS is the same with the opposite sign, and z is also "
        "the focal length's in nadir images"
    ),
    about="""The control as a whole stands in another datum than the GNSS (given minus true).

    Another geoid, another base station, another realisation of the reference frame.

    Source: Zhou 2019, section 5.6 (height bias of GNSS-assisted blocks).
    """,
)


class ControlBlunder(LinearEffect):
    slug = "control_blunder"
    title = "Wrong coordinates of one control point"
    called = "an error in the given coordinates of a control point"
    place = "ground"
    needs = ("ground.x", "ground.y", "ground.z")
    group = "point"
    revealed_by = "the other control points and the GNSS, which agree without this one"
    unobservable_when = (
        "neither GNSS nor enough other control points determine the block without it"
    )
    variants = (_OF_THE_BLOCK,)

    def parameters(self, block):
        return [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """The given coordinates move by the values themselves."""
        return np.broadcast_to(np.eye(3), (len(context), 3, 3))
