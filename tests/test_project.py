"""What the project promises about itself: rooms, pins."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# What verbs have in common, the command and the engine are no rooms with a counter.
OPEN = {"cli", "command", "engine"}
ROOMS = sorted(
    p.parent.relative_to(ROOT / "corridor").parts
    for p in (ROOT / "corridor").glob("*/*/__init__.py")
    if p.parent.parent.name in ("core", "tools", "interface") and p.parent.name not in OPEN
)
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("place", [".".join(parts) for parts in ROOMS] + ["diagnosis"])
def test_every_room_is_private_but_for_its_init(place):
    contracts = {c["id"]: c for c in SETTINGS["tool"]["importlinter"]["contracts"]}
    room = place.rpartition(".")[2]
    assert contracts[room]["protected_modules"] == [f"corridor.{place}.*"]
    assert contracts[room]["allowed_importers"] == [f"corridor.{place}"]


def test_every_dependency_is_pinned_to_a_version_and_to_no_address():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][0-9A-Za-z.]*", pin) for pin in pins)
    pinned = {_plain(pin.partition("==")[0]) for pin in pins}
    project = SETTINGS["project"]
    wanted = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    names = {_plain(re.match(r"[A-Za-z0-9._-]+", text)[0]) for text in wanted} - {"corridor"}
    assert names <= pinned


def _plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()
