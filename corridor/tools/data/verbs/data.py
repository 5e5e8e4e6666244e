"""List the blocks that can be had, shipped and real, or fetch one of them.

examples:
  corridor data list
      what there is: name, size, source, licence
  corridor data fetch dike -o dike
      the shipped block, to try everything on
  corridor data fetch m300_ppk -o m300_ppk
      a real track and its exposures from their public source (needs the extra `data`)

What is fetched is compared with the hash that is known of it, or with what is known of its
content, and converted by the readers of `corridor import` and `corridor gnss`. OUT appears when all
of that has gone well, or not at all. Real data are other people's: each set says whose, and what
one may do with it.
"""

import argparse
import textwrap

from corridor.core.command.options import option, say, wrote
from corridor.core.errors import InputError

OPTIONS = {
    "what": option("list, or fetch", choices=("list", "fetch")),
    "name": option("of a set, for fetch", "NAME", nargs="?"),
    "--output": option("folder to write, for fetch (default: NAME)", "OUT"),
    "--mirror": option(
        "an address that has the files of the set by their names; for sets with hashes", "URL", str
    ),
}


def run(options: argparse.Namespace) -> None:
    """List, or fetch one set and say what was checked."""
    from corridor.tools import data

    if options.what == "list":
        for one in data.register().values():
            size = f"{one.size_mb:g} MB, " if one.size_mb else ""
            print(one.name)
            hashed = "" if one.verified else "; not verified, no hash is known"
            for text in (one.about, f"{size}{one.source}; licence: {one.licence}{hashed}"):
                print(textwrap.fill(text, 96, initial_indent="  ", subsequent_indent="  "))
        return
    if options.name is None:
        raise InputError(f"fetch which set? One of {', '.join(data.register())}")
    output = options.output or options.name
    for sentence in data.fetch(options.name, output, options.mirror, progress=say):
        print(sentence)
    wrote(output)
