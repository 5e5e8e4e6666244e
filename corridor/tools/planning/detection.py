"""The level of detection of a planned flight: where two such flights would show which change."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pandas as pd

from corridor.core import registry
from corridor.core.block import Block
from corridor.core.errors import InputError
from corridor.core.simulation import Plan, add_noise
from corridor.tools.planning.network import without_control
from corridor.tools.planning.noise import GnssNoise
from corridor.tools.planning.planner import Believed

if TYPE_CHECKING:
    from corridor.tools.change import SurfaceChange


def detectable(plan: Plan, laid_out: Block, believed: Believed) -> SurfaceChange:
    """The surface of a flight set with the levels of detection of two flights like it.

    laid_out: its images with the ground points that are to be surveyed, at both dates anew.
    The noise is drawn once: heights of tie points tell how rough the ground is between them.
    Raises InputError where a camera is carried over.
    """
    if believed.carried is not None:
        raise InputError(
            "the level of detection is that of flights adjusted on their own: plan it without "
            "--carry-over, with --camera fixed where the calibration holds"
        )
    seed, noise = believed.seed, believed.noise or GnssNoise()
    stated = laid_out.sigma
    shown = laid_out.marks["point"].isin(laid_out.ground["point"])
    block = replace(
        without_control(plan, seed), ground=laid_out.ground, marks=laid_out.marks[shown],
        sigma=dict(stated),
    )  # fmt: skip
    kinds = ("tie_px", "mark_px", "gnss_m", "control_m")
    sizes = {kind: stated[kind] for kind in kinds} | {"distance_m": plan.noise.distance_m}
    flown = add_noise(block, **sizes, seed=seed)
    # A survey of control is made anew at each date: nothing of it is common.
    return registry.room("change").detection(
        flown, believed.as_model(), common=("priors",), gnss_bias=noise.bias_sigma_m
    )


def columns(surface: SurfaceChange) -> pd.DataFrame:
    """What is known before any change: place, sigma, sampling, level of detection (m)."""
    kept = ["x", "y", "z", "station", "across", "sigma", "sampling", "detection_95"]
    return surface.frame[kept]
