"""List the effects that can be estimated, or describe one of them in full.

examples:
  corridor effects
      the catalogue
  corridor effects rolling_shutter
      what it models, what reveals it, what it needs, its source
"""

import argparse
import textwrap

from corridor.core.command.options import option

OPTIONS = {"slug": option("name of one effect", "SLUG", nargs="?")}


def run(options: argparse.Namespace) -> None:
    """Print the catalogue or one effect."""
    from corridor.core.effects import every_effect, find

    if options.slug is None:
        print("\n\n".join(_short(effect) for effect in every_effect()))
        print(
            "\n`corridor effects SLUG` describes one; `corridor adjust --effect SLUG` estimates it."
        )
    else:
        print(_full(find(options.slug)))


def _short(effect):
    parameters = ", ".join(
        name + (f" ({p.unit})" if p.unit != "1" else "") for name, p in _runs(effect)
    )
    needs = ", ".join(effect.needs) or "nothing more than the images"
    generic = ", generic" if effect.generic else ""
    shared = "the block" if effect.group == "block" else f"each {effect.group}"
    return (
        f"{effect.slug}\n  {effect.title}\n  acts on    {effect.place}{generic}\n  estimates  "
        f"{parameters} for {shared}\n  needs      {needs}"
    )


def _full(effect):
    runs = _runs(effect)
    scales = ", ".join(_usual(p) + f" ({name})" for name, p in runs)
    texts = "; ".join(f"{name}: {p.text}" for name, p in runs if p.text)
    facts = (
        _line("shown by", effect.revealed_by),
        _line("hidden if", effect.unobservable_when),
        _line("usual size", scales),
    )
    more = (_line("meaning", texts),) if texts else ()
    short = "\n".join([_short(effect), *facts, *more])
    return "\n\n".join([short, *effect.described()])


def _usual(parameter):
    """A usual size with its unit, as results tell it."""
    from corridor.core.output import scaled

    factor, unit = scaled(parameter.unit, parameter.scale, name=parameter.name)
    return f"{factor * parameter.scale:.3g} {unit}".strip()


def _line(title, text):
    indent = {"initial_indent": f"  {title:10s} ", "subsequent_indent": " " * 13}
    return textwrap.fill(text, 100, **indent, break_on_hyphens=False)


def _runs(effect):
    """(name, parameter) of the parameters; `x_1 to x_60` for a run of numbered ones."""
    runs = []
    for parameter in _parameters(effect):
        stem, _, number = parameter.name.rpartition("_")
        if runs and number.isdecimal() and runs[-1][0] == (stem, parameter.unit):
            runs[-1][2] = parameter
        else:
            runs.append([(stem, parameter.unit), parameter, parameter])
    return [
        (first.name if first is last else f"{first.name} to {last.name}", last)
        for _, first, last in runs
    ]


def _parameters(effect):
    import pandas as pd

    from corridor.core.block import Block
    from corridor.core.camera import Camera

    # What an effect estimates may depend on the block; a picture of a usual size stands for it.
    camera = Camera.from_table("camera", {"width": 6000, "height": 4000, "f": 6000.0})
    images = pd.DataFrame({"image": ["1"], "camera": ["camera"]})
    return effect.parameters(Block(name="any", cameras={"camera": camera}, images=images))
