"""Make a small anonymous copy of a block that shows a fault, for a report.

examples:
  corridor report-bug BLOCK -o fault
      a part of the block on which `corridor adjust` ends as it does on the whole
  corridor report-bug BLOCK --command "diagnose --camera fraser8" -o fault
      the same of another command

OUT holds block/ and fault.txt: the command, how it ended, versions. Names are replaced, coordinates
begin near zero, times too; texts, columns of your own, offset and reference system are left out;
heights and distances stay what they are. Look at the files before you send them.
"""

import argparse

from corridor.core.command.options import option, say, wrote

OPTIONS = {
    "block": {},
    "--command": option("a verb with its options, without the block", "WORDS", default="adjust"),
    "--output": option("folder to write", "OUT", required=True),
}
MARK = "fault.txt"


def run(options: argparse.Namespace) -> None:
    """Write the copy and say what it shows."""
    from corridor.tools.faults import report

    found = report(options.block, options.command, options.output, progress=say)
    if found.shown:
        print(f"shows the fault: {found.images} of {found.whole} images")
        print(found.said)
    else:
        print(
            f"corridor {options.command} ends well, so nothing could be compared: "
            f"{found.images} of {found.whole} images; say in the report what is wrong with them"
        )
    wrote(options.output / MARK)
