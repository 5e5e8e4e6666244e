"""A readout that block.toml states, and what the images show of it."""

from dataclasses import replace

import pytest
from strips import corridor_block

from corridor.diagnosis.findings.findings import Estimate, Findings
from corridor.diagnosis.report.wording import unseen_statements

LIMITS = {"rolling_shutter": {"readout": 0.005}}


@pytest.mark.parametrize(
    ("found", "told"),
    [(None, True), ("clock_offset", True), ("rolling_shutter", False),
     ("rolling_shutter_rotation", False)],
)  # fmt: skip
def test_it_is_doubted_unless_the_camera_is_seen_to_move_while_rows_are_read(found, told):
    block = corridor_block(images=8, observations_per_image=10, seed=1)
    cameras = {name: replace(one, readout_s=0.03) for name, one in block.cameras.items()}
    effects = [] if found is None else [Estimate(found, "named", 9.0, [])]
    said = unseen_statements(replace(block, cameras=cameras), Findings(effects, []), LIMITS)
    assert bool(said) == told
