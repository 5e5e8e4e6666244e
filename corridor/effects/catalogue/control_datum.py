"""The ground control as a whole stands in another datum than the GNSS (given minus true).

Another geoid, another base station, another realisation of the reference frame.

Source: Zhou 2019, section 5.6 (height bias of GNSS-assisted blocks).
"""

from corridor.effects.catalogue.control_blunder import ControlBlunder


class ControlDatum(ControlBlunder):
    slug = "control_datum"
    title = "Common shift of all ground control points"
    called = "a common shift of all ground control"
    group = "block"
    revealed_by = "GNSS with known lever arms: all control points disagree with it by one vector"
    unobservable_when = (
        "there is no GNSS; a bias of the GNSS is the same with the opposite sign, and z is also "
        "the focal length's in nadir images"
    )
