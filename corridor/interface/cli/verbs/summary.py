"""Show what is in a block, and what cannot be done for lack of data.

examples:
  corridor summary data_synthetic/dike
      the shipped block: what is in it, and what looks wrong
  corridor summary BLOCK -o out/look
      also saves a first-look picture there
"""

import argparse

from corridor.core.command.options import option, wrote

OPTIONS = {"block": {}, "--output": option("folder for the first-look picture")}


def run(options: argparse.Namespace) -> None:
    """Print the summary and the effects that want more data; draw the block if asked."""
    import corridor
    from corridor.core import output as report
    from corridor.core.adjustment import without_wild_cells
    from corridor.core.preparation import (
        astray,
        coarse_sigmas,
        derived_table,
        plausibility_warnings,
        prepare,
        without_starts,
    )

    block = corridor.read(options.block)
    look = corridor.summary(block)
    told = [*plausibility_warnings(block), *coarse_sigmas(block)]
    # A start pose that its own points contradict is no witness of the GNSS.
    seen = without_starts(block, astray(block))
    try:
        told = [*without_wild_cells(seen, corridor.Model())[1], *told]
    except corridor.InputError as error:
        # Often it is what has been told at first sight.
        file = str(error).split()[0]
        told += [] if any(file in one for one in told) else [str(error)]
    look.notes = [*told, *look.notes]
    print(look)
    table = derived_table(prepare(block).block)
    if table is not None:
        print(f"\n{table}")
    if options.output is not None:
        path = options.output / "first_look.png"
        with report.whole_file(path) as part:
            report.write_picture(corridor.figures.first_look(block), part)
        wrote(path)
