"""The GNSS positions drift away while time goes on (measured minus true).

Source: Takasu and Yasuda 2009, "Development of the low-cost RTK-GPS receiver with RTKLIB" (float
solutions converge and wander for minutes).
"""

import numpy as np

from corridor.core.effects.contract import LinearEffect, Parameter


class GnssDrift(LinearEffect):
    slug = "gnss_drift"
    title = "GNSS positions that drift with time"
    called = "a drift of the GNSS positions with time"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.time_s")
    revealed_by = "ground control, or strips that see the same ground at different times"
    unobservable_when = (
        "one strip without control: it is a turn or a stretch of the strip; its z looks like a "
        "focal drift without oblique images"
    )
    # 0.1 m in 10 minutes.
    unknowns = [Parameter(axis, "m/s", scale=0.1 / 600.0) for axis in ("x", "y", "z")]

    def derivative(self, context):
        """The measured antenna moves by rate t, t in seconds from the middle of the block."""
        return context.time[:, None, None] * np.eye(3)
