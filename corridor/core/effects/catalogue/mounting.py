"""A member of a rig does not hang where it was said to hang: a shift and a turn for each member.

Source: Rupnik, Nex and Remondino 2014, "Oblique multi-camera systems", section 3 (relative
orientation of the members, shared by all exposures).
"""

import copy

import numpy as np

from corridor.core.block import POSE, members_of, mountings_of
from corridor.core.effects.context import Images
from corridor.core.effects.contract import LinearEffect, Parameter
from corridor.core.geometry import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
)

# A number that is known exactly has a sigma that no image comes near: m and rad.
_EXACT = 1e-9


class Mounting(LinearEffect):
    slug = "mounting"
    title = "Mounting of a rig's member, to be added to the stated one"
    called = "a correction of where a camera of the rig hangs"
    place = "motion"
    group = "member"
    needs = ("rig.member",)
    row_degree = 0
    revealed_by = "tie points that members share, in one exposure or the next"
    unobservable_when = (
        "members see nothing that another one sees; the shift along the axis is the focal length "
        "over flat ground"
    )
    # What a calibration leaves: a mounting that is known less well is estimated in any case.
    unknowns = [Parameter(axis, "m", scale=0.005) for axis in "xyz"] + [
        Parameter(f"turn_{axis}", "rad", scale=0.002) for axis in "xyz"
    ]

    def believed(self, block):
        """Wherever cameras hang together, unless every mounting is known exactly."""
        return block.has("rig.member") and any(m.sigma.any() for m in mountings_of(block).values())

    def priors(self, block):
        """What is stated; of mountings that are all exact none, whoever asks doubts them."""
        if not self.believed(block):
            return {}
        names = [parameter.name for parameter in self.unknowns]
        mountings = mountings_of(block)
        return {
            (name, camera): (0.0, max(float(sigma), _EXACT))
            for camera in members_of(block)
            for name, sigma in zip(names, mountings[camera].sigma, strict=True)
            if np.isfinite(sigma)
        }

    def restated(self, block, values):
        """[rig.NAME] with the mountings that were found, and the poses that follow from them."""
        poses, rigs = block.poses.copy(), copy.deepcopy(block.extra["rig"])
        turned = rotation_from_quaternion(poses[:, 3:])
        images = Images.of(block)
        for k, (camera, rig) in enumerate(members_of(block).items()):
            mounting, shift = mountings_of(block)[camera], values[k, :3]
            turn, mine = rotation_from_vector(-values[k, 3:]), images.member == k
            poses[mine, :3] += np.einsum("nji,j->ni", turned[mine], shift)
            poses[mine, 3:] = quaternion_from_rotation(turn @ turned[mine])
            rigs[rig]["member"][camera] |= {
                "xyz": (mounting.place + mounting.rotation.T @ shift).tolist(),
                "quaternion": quaternion_from_rotation(turn @ mounting.rotation).tolist(),
            }
        out = block.copy()
        out.put("images", POSE, poses)
        out.extra["rig"] = rigs
        return out

    def derivative(self, context):
        """The centre moves by R' a and the camera turns by w, both in the member's frame."""
        derivative = np.zeros((len(context), 6, 6))
        hangs = context.group("member") >= 0
        derivative[hangs, :3, :3] = context.rotation[hangs].transpose(0, 2, 1)
        derivative[hangs, 3:, 3:] = np.eye(3)
        return derivative
