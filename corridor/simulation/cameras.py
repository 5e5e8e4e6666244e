"""Cameras that a plan may call by name."""

import tomllib
from functools import cache
from pathlib import Path

from corridor.camera import Camera

_FILE = Path(__file__).with_name("cameras.toml")


@cache
def cameras() -> dict[str, Camera]:
    """The cameras of `cameras.toml` by name."""
    tables = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    return {
        name: Camera.from_table(name, {k: v for k, v in table.items() if k != "source"})
        for name, table in tables.items()
    }


CAMLIGHT = cameras()["camlight"]
