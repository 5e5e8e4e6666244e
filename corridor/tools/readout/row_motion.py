"""The readout time that the motion of each image during its readout tells, with honest errors.

While its rows are read, image i moves by w_i = r v_i + e_i: r the readout time, v_i the velocity
as it is known, e_i what is not known of it: its standard deviation times r, the delay with which
the speed was written times the acceleration, and motion that nobody wrote down. It turns as well,
by what nobody wrote down either. The equations of the flight have columns for every motion and
turn; r follows by generalised least squares with their covariance, whose unknown part is estimated
by restricted likelihood.

Source: Patterson and Thompson 1971 (restricted likelihood); Fuller 1987, section 1.2 (errors of
a regressor); Efron and Tibshirani 1993, chapter 11 (jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.sparse import csc_array, diags_array, eye_array, hstack
from scipy.sparse.linalg import splu

from corridor.core.adjustment import Adjustment, LinearSystem, Loss
from corridor.core.block import Block
from corridor.core.brief import brief
from corridor.core.effects import Effect, every_effect
from corridor.tools.readout.motion import Motion

# The parameter of every effect that has a readout.
READOUT = "readout"
# Below this a readout scales no error of a velocity any more: a global shutter.
LEAST_S = 0.002
# Motion that nobody wrote down, m/s: what is looked at.
_UNSTATED_M_S = (0.02, 0.06, 0.2, 0.6, 2.0)
# A readout that changes by less than this share scales its errors as before.
_SAME = 0.1
# Weight of what the equations leave open, relative to the largest of their diagonal.
_OPEN = 1e-13


# Which effects of the catalogue tell a readout: by what they act on and need, not by name.


def shutter(block: Block) -> Effect:
    """What moves the camera during the readout as its velocity says, for one readout time.

    With rates.csv: what turns it as the gyroscope says, too.
    """
    forms = [one.form(block) for one in _at("motion") if one.during_readout]
    turned = [o for o in forms if o.needs_table("rates") and "images.vx" in o.takes]
    return (turned or [one for one in forms if "images.vx" in one.needs])[0]


def free_motion(block: Block) -> Effect:
    """What moves and turns every image on its own during the readout: the freest of its kind."""
    free = [one for one in _at("motion") if one.group == "image" and one.generic]
    return max(free, key=lambda one: len(one.parameters(block)))


@cache
def late_clock() -> Effect:
    """What moves antenna positions as the velocity says: they are late."""
    return next(one for one in _at("antenna") if "images.vx" in one.needs and one.group == "block")


def _at(place: str) -> list[Effect]:
    return [one for one in every_effect() if one.place == place]


@dataclass(frozen=True)
class Told:
    """readout and sigma, s; delay, s (positive: the speed was written late), and its sigma;
    likelihood: -2 log of the restricted one, up to a constant."""

    readout: float
    sigma: float
    delay: float
    delay_sigma: float
    likelihood: float


@brief
@dataclass(frozen=True, eq=False)
class RowMotions:
    """Equations of a flight with a column for the motion of every image during its readout.

    system: at the result of an adjustment that estimates the shared readout. sigma0: of unit
    weight. motion: in the order of the system's images.
    """

    system: LinearSystem
    sigma0: float
    motion: Motion

    @classmethod
    def of(cls, adjustment: Adjustment, motion: Motion) -> RowMotions:
        """The equations at an adjustment with the shutter's readout; motion: as in images.csv."""
        loss = Loss.parse(adjustment.problem.model.loss)
        system = LinearSystem(adjustment.problem, adjustment.state, loss)
        return cls.at(system, adjustment.sigma0, motion)

    @classmethod
    def at(cls, system: LinearSystem, sigma0: float, motion: Motion) -> RowMotions:
        """The equations of a system that has no columns for the motions yet."""
        system = replace(system.testing([free_motion(system.block)]), gnss_counts=True)
        return cls(system, sigma0, motion.rows(system.image_order))

    @cached_property
    def _equations(self) -> tuple[csc_array, np.ndarray]:
        """N and t at unit weight 1, with columns for the errors that velocities share behind."""
        s2 = self.sigma0**2
        matrix = csc_array(self.system.matrix / s2)
        n, shared = matrix.shape[0], self.motion.shared
        columns = np.zeros((n, len(shared)))
        columns[self._motions[:, :3].ravel()] = shared.reshape(len(shared), -1).T
        widened = csc_array(hstack([eye_array(n), csc_array(columns)]))
        right = self.system.right / s2
        return csc_array(widened.T @ matrix @ widened), widened.T @ right

    @cached_property
    def _motions(self) -> np.ndarray:
        """Columns (m, 6) of the motions and turns of the images."""
        return self.system.columns.of_image[free_motion(self.system.block).slug]

    @cached_property
    def _readout(self) -> int:
        effect = shutter(self.system.block)
        names = [parameter.name for parameter in effect.parameters(self.system.block)]
        return int(self.system.columns.of(effect.slug)[names.index(READOUT)])

    @cached_property
    def height(self) -> float:
        """Of the cameras above the ground, m."""
        images = self.system.images
        return max(float(np.median(images.centre[:, 2]) - images.ground), 1.0)

    @property
    def estimated(self) -> float:
        """The readout at which the equations stand, s."""
        return float(self.system.columns.value[self._readout])

    def told(self, readout: float, unstated: float, affine: bool = True) -> Told:
        """The readout by generalised least squares.

        readout: s, with which errors of velocities count. unstated: m/s, standard deviation of
        motion that nobody wrote down, and over the height above ground that of turns. affine: b1
        and b2 are free; else they are zero.
        """
        matrix, right = self._equations
        n = matrix.shape[0]
        scale = max(abs(readout), LEAST_S)
        weight = np.zeros(n)
        moved = np.hypot(self.motion.independent, unstated)
        turned = np.hypot(self.motion.turning, unstated / self.height)
        weight[self._motions] = (scale * np.hstack([moved, turned])) ** -2.0
        behind = n - len(self.motion.shared)
        weight[behind:] = scale**-2.0
        pull = np.zeros(n)
        if not affine:
            columns = self.system.columns
            for number, unknown in zip(columns.shared_at, columns.shared, strict=True):
                if unknown.kind == "camera" and unknown.name in ("b1", "b2"):
                    weight[number] = 1e16
                    pull[number] = -1e16 * columns.value[number]
        diagonal = matrix.diagonal()
        # Images that were left out have nothing to say of themselves.
        opened = _OPEN * max(diagonal.max(), 1.0)
        whole = csc_array(matrix + diags_array(weight + opened))
        factor = splu(
            whole, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
        wanted = np.zeros((n, 3))
        wanted[:, 0] = right + pull
        wanted[self._readout, 1] = wanted[behind, 2] = 1.0
        found, by_readout, by_delay = factor.solve(wanted).T
        logarithm = np.log(np.abs(factor.U.diagonal())).sum()
        return Told(
            readout=self.estimated + found[self._readout],
            sigma=float(np.sqrt(by_readout[self._readout])),
            delay=float(found[behind] / scale * self.motion.delay_s),
            delay_sigma=float(np.sqrt(by_delay[behind]) / scale * self.motion.delay_s),
            likelihood=float(logarithm - np.log(weight[weight > 0]).sum() - (right + pull) @ found),
        )

    def best(self) -> tuple[Told, float]:
        """The readout, and the motion that nobody wrote down (m/s) which the images show."""
        readout, unstated = self.estimated, _UNSTATED_M_S[0]
        for _ in range(3):
            unstated = self._unstated(readout)
            found = self.told(readout, unstated)
            change, readout = abs(found.readout - readout), found.readout
            if change < _SAME * max(abs(readout), LEAST_S):
                break
        return found, unstated

    def _unstated(self, readout: float) -> float:
        """Of greatest restricted likelihood: the lowest of a parabola in its logarithm."""
        at = np.log(_UNSTATED_M_S)
        cost = np.array([self.told(readout, size).likelihood for size in _UNSTATED_M_S])
        low = int(np.clip(np.argmin(cost), 1, len(at) - 2))
        near = slice(low - 1, low + 2)
        bend, slope, _ = np.polyfit(at[near], cost[near], 2)
        best = -slope / (2 * bend) if bend > 0 else at[np.argmin(cost)]
        return float(np.exp(np.clip(best, at[near][0], at[near][-1])))

    def without(self, images: np.ndarray) -> RowMotions:
        """The equations without what some images (rows of images.csv) saw."""
        rows = self.system.image_rows
        gone = np.isin(self.system.image_order, images)
        sigma = np.where(gone[rows.image], np.inf, rows.sigma)
        left = np.bincount(rows.point, np.isfinite(sigma), minlength=rows.point.max() + 1)
        sigma = np.where(left[rows.point] > 1, sigma, np.inf)
        return replace(self, system=self.system.measuring(sigma=sigma))
