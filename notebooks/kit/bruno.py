"""Is a model of the shutter needed? The shipped dike flown evenly and not (Bruno, Forlani 2023)."""

from __future__ import annotations

from pathlib import Path

import corridor
from corridor.core.simulation import Plan, read_plan
from kit.draws import Table

PLAN = Path(__file__).resolve().parents[2] / "data_synthetic" / "dike.toml"
READOUT_S = 0.025
WAYS = {
    "turned": {},
    "kept": {"heading": "kept"},
    "even": {
        "angular_rate_deg_s": 0.0, "attitude_jitter_deg": 0.0, "velocity_jitter_m_s": 0.0,
        "wind_m_s": 0.0,
    },
}  # fmt: skip


def flown(way: str) -> Plan:
    """The dike in one of `WAYS`: even is without wind, at one speed and attitude, and not turned
    while the rows are read."""
    return read_plan(PLAN).with_flights(**WAYS[way])


def _draw(way, seed):
    """3D RMS of the check points (mm): with b1 and b2 alone, and with the shutter."""
    block = corridor.simulate(flown(way), {"rolling_shutter": {"readout": READOUT_S}}, seed=seed)
    return {
        word: 1000 * corridor.adjust(block, camera="fraser10", effects=effects).check_rms.d3
        for word, effects in (("blind", []), ("aware", ["rolling_shutter"]))
    }


TABLE = Table("bruno", ("way", "seed"), [(way, seed) for way in WAYS for seed in range(8)], _draw)
