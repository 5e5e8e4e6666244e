"""What several rooms' tests share."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real measurements, which is not part of the project."""
    named = os.environ.get("CORRIDOR_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(
            "no real data: CORRIDOR_DATA names no folder"
            if named
            else "no real data: put them at ../shared/data or let CORRIDOR_DATA name their folder"
        )
    return folder
