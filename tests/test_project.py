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


def test_what_is_hashed_is_what_is_pinned():
    """requirements-hashed.txt: each package of `corridor[all]` at its pin, with SHA-256."""
    text = (ROOT / "requirements-hashed.txt").read_text(encoding="utf-8")
    text = re.sub(r"^#.*\n", "", text, flags=re.MULTILINE).replace("\\\n", " ")
    hashed = {}
    for line in text.splitlines():
        pin, *hashes = re.split(r"\s+--hash=", line.strip())
        assert hashes and all(re.fullmatch(r"sha256:[0-9a-f]{64}", one) for one in hashes), pin
        name, _, version = pin.partition(";")[0].strip().partition("==")
        hashed[_plain(name)] = version
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(pin.split("==") for pin in pins if pin and not pin.startswith("#"))
    pinned = {_plain(name): version for name, version in pinned.items()}
    # Of other systems alone: what colours a terminal of Windows.
    assert {name: pinned.get(name, "1") for name in hashed.keys() - {"colorama"}} == {
        name: version for name, version in hashed.items() if name != "colorama"
    }
    project = SETTINGS["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(x for e in _all(extras) for x in extras[e])]
    assert {_plain(re.match(r"[A-Za-z0-9._-]+", x)[0]) for x in wanted} <= hashed.keys()


def _all(extras):
    return re.fullmatch(r"corridor\[(.*)\]", extras["all"][0])[1].split(",")


def test_the_conda_recipe_asks_for_what_the_project_asks_for():
    text = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    listed = re.findall(
        r"^    - ([\w-]+) ?([<>=0-9.,]*)$", text[text.index("  run:") :], re.MULTILINE
    )
    recipe = dict(listed)
    # Other names of the same there; the headless build of OpenCV is a pip matter.
    names = {"matplotlib": "matplotlib-base", "opencv-python-headless": "py-opencv"}
    for text in SETTINGS["project"]["dependencies"]:
        name, bounds = re.fullmatch(r"([\w-]+)(.*)", text).groups()
        assert recipe[names.get(name, name)] == bounds
    assert recipe["python"] == SETTINGS["project"]["requires-python"]


def _plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()
