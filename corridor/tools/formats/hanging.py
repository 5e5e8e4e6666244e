"""The rigs of a block as other programs write them, where its images stand as they say."""

from dataclasses import dataclass

import numpy as np

from corridor.core.block import (
    Block,
    Mounting,
    as_mounted,
    base_poses,
    exposures_of,
    mountings_of,
    rigs_of,
)


@dataclass(frozen=True)
class Hanging:
    """mounted: of each camera of a rig; none where images do not stand as their rig says, which are
    alone then. base: of each camera that of its rig, itself without one. pose: (n, 7) as
    `Block.poses`, where each image puts that base. together: (n,) first image of its exposure.
    """

    mounted: dict[str, Mounting]
    base: dict[str, str]
    pose: np.ndarray
    together: np.ndarray

    @classmethod
    def of(cls, block: Block) -> "Hanging":
        """That of a block."""
        mounted = mountings_of(block) if as_mounted(block) else {}
        base = {name: name for name in block.cameras}
        base |= {name: rigs_of(block)[one.rig]["base"] for name, one in mounted.items()}
        together = np.arange(len(block.images))
        if mounted:
            both = exposures_of(block)
            together[both.member] = both.base
        return cls(mounted, base, base_poses(block, mounted), together)

    def members(self) -> dict[str, Mounting]:
        """The mountings of cameras that are not the base of their rig."""
        return {name: one for name, one in self.mounted.items() if self.base[name] != name}

    def frames(self) -> list[np.ndarray]:
        """Rows of images.csv of each exposure."""
        order = np.argsort(self.together, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.together[order])) + 1)
