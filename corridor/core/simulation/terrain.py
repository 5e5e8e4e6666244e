"""Ground of a corridor: a dike along the axis, with smooth roughness."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import PchipInterpolator

# Cross-section over the relief: distance from the axis in crest heights, height in crest heights.
# Water on the left of the axis (slope 1:2.5 to below the plain), berm on the right.
_ACROSS = (-9.0, -3.8, -0.7, 0.7, 2.2, 3.6, 4.8, 9.0)
_UP = (-0.25, -0.25, 1.0, 1.0, 0.4, 0.4, 0.0, 0.0)
_WAVES = 24


@dataclass(frozen=True)
class Dike:
    """A dike that follows the axis of a corridor.

    relief: crest above the plain, metres; 0 gives a plane. level: height of the plain, metres.
    seed: of the roughness, plane waves of 8 to 200 m. roughness: RMS of their sum, metres;
    default: a twelfth of the relief.
    """

    relief: float = 3.0
    level: float = 0.0
    seed: int = 0
    roughness: float | None = None
    _section: PchipInterpolator = field(init=False, repr=False, compare=False)
    _waves: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        section = PchipInterpolator(_ACROSS, _UP)
        rms = self.relief / 12 if self.roughness is None else self.roughness
        draw = np.random.default_rng([self.seed, 1])
        length = np.geomspace(8.0, 200.0, _WAVES)
        direction, phase = draw.uniform(0, 2 * np.pi, (2, _WAVES))
        amplitude = np.sqrt(length)
        amplitude *= np.sqrt(2) * rms / np.linalg.norm(amplitude)
        number = 2 * np.pi / length
        waves = np.stack([number * np.cos(direction), number * np.sin(direction), phase, amplitude])
        object.__setattr__(self, "_section", section)
        object.__setattr__(self, "_waves", waves)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest the ground can be, metres."""
        waves = np.abs(self._waves[3]).sum()
        low, high = sorted(self.relief * np.array([min(_UP), max(_UP)]))
        return float(self.level + low - waves), float(self.level + high + waves)

    def height(self, along: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Height (n,) of the ground, metres, at distances along and to the right of the axis (n,).

        Crest half-width, slopes and berm grow with the relief.
        """
        along, across = np.broadcast_arrays(np.asarray(along, float), np.asarray(across, float))
        height = np.full(along.shape, float(self.level))
        if self.relief:
            reach = _ACROSS[-1]
            height += self.relief * self._section(np.clip(across / self.relief, -reach, reach))
        for a, c, phase, amplitude in self._waves.T:
            if amplitude:
                height += amplitude * np.sin(a * along + c * across + phase)
        return height
