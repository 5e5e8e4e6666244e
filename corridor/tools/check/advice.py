"""What an adjustment and a diagnosis say to the program that a project comes from."""

import math
from dataclasses import dataclass, field

import numpy as np

from corridor.core.block import Block
from corridor.core.errors import some
from corridor.core.output import counted, millimetres, significant

# A value of distortion or arm below this many standard deviations may be zero (95 %).
_SIGNIFICANT = 2.0
# Without these nothing is projected: they are estimated wherever they can be.
_ALWAYS = ("f", "cx", "cy")
# A standard deviation of r spare observations is good to 1 / root(2 r): to a half from here on.
_LEAST_SPARE = 2.0
_RESIDUALS = {"tie": "tie points", "mark": "marks"}


@dataclass(frozen=True)
class ProgramSettings:
    """Settings for another program.

    cameras: camera -> parameters that the block determines, and those that may be zero; both empty
    where the camera is held. image: px of tie points and marks. positions: m horizontally and in
    height, of camera positions. arms: flight -> antenna in the camera frame and sigmas, m. without:
    control points to take out. effects: what the program has to model, or gets corrected
    measurements for.
    """

    cameras: dict[str, tuple[list[str], list[str]]]
    image: dict[str, float] = field(default_factory=dict)
    positions: tuple[float, float] | None = None
    arms: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    without: list[str] = field(default_factory=list)
    effects: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, adjustment: dict, found: dict | None, block: Block) -> "ProgramSettings":
        """Settings of adjustment.json and diagnosis.json."""
        cameras: dict[str, tuple[list[str], list[str]]] = {}
        for camera, parameters in adjustment["camera"].items():
            cameras[camera] = free, hold = [], []
            for name, one in parameters.items():
                value, sigma = one["value"], one["sigma"]
                if not sigma or value is None:
                    continue
                # Alone each may be zero, and yet not all together, which the adjustment says.
                may = abs(value) <= _SIGNIFICANT * sigma
                if "may_be_zero" in adjustment:
                    may = name in adjustment["may_be_zero"].get(camera, [])
                firm = name in _ALWAYS or not may
                (free if firm else hold).append(name)
        named = [one for one in (found or {}).get("effects") or [] if one.get("class") == "named"]
        observed = adjustment["observations"]
        image = {
            said: float(observed[kind]["rms"]) * more
            for kind, said in _RESIDUALS.items()
            if observed.get(kind, {}).get("rms") and (more := _more(adjustment, kind))
        }
        arms = {
            flight: [(arm[axis]["value"], arm[axis]["sigma"]) for axis in "xyz"]
            for flight, arm in adjustment["lever_arm"].items()
            if all(arm[axis]["value"] is not None and arm[axis]["sigma"] for axis in "xyz")
        }
        return cls(
            cameras=cameras,
            image=image,
            positions=_positions(adjustment, block),
            arms=arms,
            without=[str(one["point"]) for one in named if "point" in one],
            effects=[one["slug"] for one in named if "point" not in one],
        )

    def sentences(self) -> list[str]:
        """The settings in words, a line each."""
        out = []
        alike: dict[tuple[str, str], list[str]] = {}
        for camera, (free, hold) in self.cameras.items():
            alike.setdefault((", ".join(free), ", ".join(hold)), []).append(camera)
        for (free, hold), cameras in alike.items():
            whose = "the camera" if len(alike) == 1 else some(cameras, 5)
            if free:
                held = f"; hold {hold} at 0, which may be zero" if hold else ""
                out.append(f"Free the parameters of {whose}: {free}{held}.")
            else:
                out.append(f"Hold {whose} at the calibration of the project.")
        if self.image:
            told = ", ".join(
                f"{what} {significant(value)} px" for what, value in self.image.items()
            )
            out.append(f"Accuracy of image measurements: {told}.")
        if self.positions is not None:
            level, up = self.positions
            out.append(
                f"Accuracy of camera positions: {millimetres(level)} horizontally, "
                f"{millimetres(up)} in height."
            )
        for flight, arm in self.arms.items():
            if any(abs(value) > _SIGNIFICANT * sigma for value, sigma in arm):
                where = "" if len(self.arms) == 1 else f" of flight {flight}"
                told = ", ".join(f"{value:.3f} +- {sigma:.3f}" for value, sigma in arm)
                out.append(
                    f"Antenna{where}, seen from the camera (right, down, forward): {told} m; "
                    "positions.csv is corrected for it."
                )
        if self.without:
            out.append(f"Take out control {', '.join(self.without)}, or survey it again.")
        if self.effects:
            effects = ", ".join(dict.fromkeys(self.effects))
            out.append(
                f"Model {effects}, or use the measurements in take_back, from which these are "
                "taken out."
            )
        return out


def _more(adjustment: dict, kind: str, part: str = "") -> float | None:
    """Standard deviation of a kind of measurements over the RMS of its residuals.

    Root of n / r, as residuals are smaller than errors; None where r says too little.
    """
    rows = [one for one in adjustment.get("variance_components") or []
            if one["kind"] == kind and one["part"] == part]  # fmt: skip
    spare = sum(float(one["redundancy"] or 0.0) for one in rows)
    return math.sqrt(sum(one["count"] for one in rows) / spare) if spare >= _LEAST_SPARE else None


def _positions(adjustment: dict, block: Block) -> tuple[float, float] | None:
    """Accuracy of positions, m: by the residuals, and what the block states where that is more or
    residuals say nothing."""
    gnss = adjustment["observations"].get("gnss")
    if not gnss or not gnss.get("rms") or not len(block.gnss):
        return None
    rms = [float(value or 0.0) for value in gnss["rms"]]
    level, up = _more(adjustment, "gnss", "plan"), _more(adjustment, "gnss", "height")
    found = [level and level * math.hypot(*rms[:2]) / math.sqrt(2), up and up * rms[2]]
    stated = [float(value) for value in np.nanmedian(block.gnss_sigma(), axis=0)]
    own = {"sx", "sy", "sz"} <= set(block.gnss)
    both = zip(found, (max(stated[:2]), stated[2]), strict=True)
    level, up = (b if a is None else max(a, b * own) for a, b in both)
    return (level, up) if math.isfinite(level + up) else None


def verdict_of(final: dict, found: dict | None, required: float | None) -> tuple[str, str]:
    """Whether it is good enough, as a word and in sentences."""
    if not final["converged"]:
        return (
            "failed",
            "The block does not adjust, so its accuracy is not known: the reason stands below.",
        )
    rms = (final["check_points"].get("rms") or {}).get("3d")
    rows = final["check_points"].get("rows") or []
    needed = "" if required is None else f"{millimetres(required)} are required"
    verdict = "not known"
    if not rows or rms is None:
        beside = f", and {needed}" if needed else ""
        told = f"Whether it is good enough is not known: there is no check point{beside}."
    else:
        told = f"Off by {millimetres(rms)} at {counted(len(rows), 'check point')} (3D RMS)"
        if required is not None:
            verdict = "good enough" if rms <= required else "not good enough"
            told = f"{verdict.capitalize()}: {told.removeprefix('Off by ')}, {needed}"
        told += "."
    said = "Whether its model lacks something was not tested (--quick)."
    said = said if found is None else str(found.get("sentence") or "")
    return verdict, f"{told} {said}".strip()
