"""A game for two: hide an effect in a flight, let your neighbour find it, open the seal."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path

import numpy as np

import corridor
from corridor.core.block import Block
from corridor.core.errors import InputError
from kit.widgets import with_words

# What can be hidden, and how strong: easy, middling, hard.
SIZES = {
    "nothing": (None, None, None),
    "rolling_shutter": ({"readout": 0.040}, {"readout": 0.010}, {"readout": 0.0005}),
    "focal_drift": ({"rate": 0.05}, {"rate": 0.02}, {"rate": 0.005}),
    "clock_offset": ({"offset": 0.05}, {"offset": 0.02}, {"offset": 0.005}),
    "gnss_drift": ({"z": 0.002}, {"z": 0.0007}, {"z": 0.0002}),
}
LEVELS = ("easy", "middling", "hard")


def hide(folder, effect: str | None = None, level: str = "easy", seed: int = 0) -> Path:
    """Fly the dike with one effect hidden; the block's folder, its seal beside it.

    effect: one of `SIZES`; None: whichever the seed draws. The seal can be opened by anybody, but
    not read by accident.
    """
    if level not in LEVELS:
        raise InputError(f"level {level!r} is unknown: give {', '.join(LEVELS)}")
    names = list(SIZES)
    draw = np.random.default_rng([seed, 13])
    slug = names[draw.integers(len(names))] if effect is None else effect
    if slug not in SIZES:
        raise InputError(f"{slug!r} is not in the game: give one of {', '.join(names)}")
    values = SIZES[slug][LEVELS.index(level)]
    plan = Path(__file__).resolve().parents[2] / "data_synthetic" / "dike.toml"
    block = corridor.simulate(plan, {} if values is None else {slug: values}, seed=seed)
    target = Path(folder)
    # As a measured block is written: its truth is nobody's to read beside it.
    Block.write(block, target)
    seal = json.dumps({"hidden": slug, "values": values or {}}).encode()
    target.with_suffix(".sealed").write_bytes(base64.b64encode(zlib.compress(seal)))
    return target


def page(folder, level: str = "easy"):
    """Three steps with buttons: hide an effect, guess or diagnose, open the seal.

    Returns an ipywidgets box; where no kernel runs, a sentence.
    """
    from ipywidgets import HTML, Button, Dropdown, HBox, IntText, VBox

    what = Dropdown(options=[("a surprise", None), *((n, n) for n in SIZES)], description="hide")
    how = Dropdown(options=LEVELS, value=level, description="level")
    number = IntText(1, description="flight")
    guess = Dropdown(options=list(SIZES), description="I say")
    told = HTML("Turn the screen away from your neighbour, choose, and hide.")
    hide_it, ask, unseal = (
        Button(description=words) for words in ("hide it", "ask the diagnosis", "open the seal")
    )

    def block():
        return Path(folder) / f"flight_{number.value}"

    def hidden(_):
        hide(block(), what.value, how.value, number.value)
        what.value = None
        told.value = f"Sealed in {block()}. Now your neighbour: look at the flight, then say."

    def asked(_):
        told.value = "adjusting and diagnosing ..."
        told.value = corridor.diagnose(corridor.read(block()), seed=number.value).sentence

    def opened(_):
        truth = open_seal(block())
        points = score(guess.value, truth["hidden"])
        told.value = f"Hidden: <b>{truth['hidden']}</b> {truth['values']}. You get {points} of 2."

    for button, act in ((hide_it, hidden), (ask, asked), (unseal, opened)):
        button.on_click(act)
    return with_words(
        VBox([HBox([what, how, number, hide_it]), HBox([guess, ask, unseal]), told]),
        "Drop-down lists and three buttons: hide it, ask the diagnosis, open the seal",
    )


def open_seal(folder) -> dict:
    """What is hidden in a block: hidden (a slug, or `nothing`), values."""
    sealed = Path(folder).with_suffix(".sealed").read_bytes()
    return json.loads(zlib.decompress(base64.b64decode(sealed)))


def answer(diagnosis) -> str:
    """What a diagnosis says is missing: a slug, several, or `nothing`."""
    return ", ".join(found["slug"] for found in diagnosis.effects) or "nothing"


def score(said: str, hidden: str) -> int:
    """2 points for the right name, 1 for seeing that something or nothing was there, else 0."""
    if said == hidden:
        return 2
    return int((said == "nothing") == (hidden == "nothing"))
