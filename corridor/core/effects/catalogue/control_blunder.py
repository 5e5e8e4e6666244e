"""One ground control point was surveyed wrongly, or its mark has moved (given minus true).

Source: Baarda 1968, "A testing procedure for use in geodetic networks".
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter, Variant

# Points of which one vector is no chance, and sigmas beyond which it is one.
_SEVERAL, _SURE = 3, 5.0

_OF_THE_BLOCK = Variant(
    slug="control_datum",
    group="block",
    datum=True,
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
    unknowns = [Parameter(axis, "m", scale=0.05) for axis in ("x", "y", "z")]

    def form(self, block):
        """A datum for each group of points that were surveyed together, where there are several."""
        several = len(set(block.ground_groups)) > 1
        return self.per("survey") if self.group == "block" and several else self

    def doubts(self, block, found):
        """Blunders of single points that are one and the same are none of single points."""
        if self.group != "point" or found["group"].nunique() < _SEVERAL:
            return []
        table = found.pivot(index="group", columns="parameter", values=["value", "sigma"])
        value, sigma = (table[part].to_numpy(float) for part in ("value", "sigma"))
        weight = sigma**-2.0
        if not np.isfinite(weight).all():
            return []
        mean = (weight * value).sum(axis=0) / weight.sum(axis=0)
        away = np.abs(value - mean) / sigma
        large = np.abs(mean) > 0.5 * np.abs(value).max()
        if not (np.abs(mean) * np.sqrt(weight.sum(axis=0)) > _SURE)[large].any():
            return []
        # Errors of single points differ from each other as much as from zero.
        if np.median(away[:, large]) > 0.1 * np.median(np.abs(value / sigma)[:, large]):
            return []
        vector = ", ".join(f"{one:+.2f}" for one in mean)
        return [
            f"All {len(value)} control points come out wrong by the same vector ({vector} m): the "
            f"datum is wrong, not single points. Either all control is off by it "
            f"(--effect {_OF_THE_BLOCK.slug}) or all GNSS positions by the opposite; with a "
            "blunder for each point the control does not hold the block at all."
        ]

    def derivative(self, context):
        """The given coordinates move by the values themselves."""
        return np.broadcast_to(np.eye(3), (len(context), 3, 3))
