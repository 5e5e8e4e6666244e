"""The GNSS positions jump at a moment and stay off: another fix, another base station.

Source: this project (a shape for what no named effect explains).
"""

from corridor.core.effects.context import Images
from corridor.core.effects.contract import Parameter, along_each
from corridor.core.effects.moments import AtMoments


class GnssStep(AtMoments):
    slug = "gnss_step"
    title = "GNSS positions that jump at a moment and stay off"
    called = "a sudden and lasting shift of the GNSS (another fix or base)"
    place = "antenna"
    needs = ("gnss.x", "gnss.y", "gnss.z", "images.time_s")
    generic = True
    revealed_by = "images that tie the positions before and after the jump to each other"
    unobservable_when = "the jump lies between two flights whose lever arms are free"
    most = 60

    def parameters(self, block):
        count = len(self.moments(Images.of(block)))
        return [Parameter(f"{a}_{k + 1}", "m", scale=0.05) for a in "xyz" for k in range(count)]

    def derivative(self, context):
        """Each axis moves by the sum of all jumps before the image was taken."""
        return along_each(self.happened(context))
