"""Build the site into out/site, without a network: `python run.py site`.

Pages written by hand (docs/pages), chapters as they were executed, commands from the parsers,
effects and the package from the docstrings. A warning is an error.
"""

import argparse
import base64
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
OUT = ROOT / "out" / "site"

EVAL = """```{{eval-rst}}
{}
```
"""
CONTENTS = """# {title}

```{{toctree}}
:maxdepth: 1

{entries}
```
"""


def main(arguments):
    """Assemble the pages and have Sphinx build them; the exit status. arguments: [where to]."""
    out = Path(arguments[0]) if arguments else OUT
    source = out.with_name(f"{out.name}-source")
    shutil.rmtree(source, ignore_errors=True)
    assemble(source)
    print("== Sphinx", flush=True)
    status = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-c", str(DOCS)]
        + ["-D", f"html_static_path={source / '_static'}", str(source), str(out)]
    ).returncode
    if status == 0:
        print(f"The site is built: open {out / 'index.html'} in a browser.")
    return status


def assemble(source):
    """Everything that Sphinx reads, in one folder."""
    sys.path.insert(0, str(ROOT))
    import effect_pages
    import lessons

    shutil.copytree(DOCS / "pages", source)
    shutil.copytree(DOCS / "_static", source / "_static")
    for name in ("sources.md", "guarantees.md", "digits.md"):
        shutil.copy(DOCS / name, source / name)
    chapters = source / "notebooks"
    shutil.copytree(ROOT / "notebooks" / "images", chapters / "images")
    found = sorted((ROOT / "notebooks").glob("*.ipynb"))
    for path in sorted((ROOT / "notebooks").glob("*.md")):
        shutil.copy(path, chapters / path.name)
    for path in found:
        write_text(chapters / path.name, folded(path.read_text(encoding="utf-8")))
    beside = sorted(path.stem for path in (ROOT / "notebooks").glob("*.md"))
    write(chapters / "index.md", CONTENTS, "Chapters", [*(p.stem for p in found), *beside])
    write_text(source / "format.md", "# " + section("What a block is"))
    write_text(source / "own_effect.md", "# " + section("An effect of your own"))
    print("== Commands", flush=True)
    commands(source / "commands.md")
    write_text(source / "api.md", api())
    write_text(source / "settings.md", settings())
    first_page(source)
    print("== Effects", flush=True)
    slugs = effect_pages.make(source / "effects")
    print("== Lessons", flush=True)
    data = source / "_static"
    measured = json.loads(lessons.MEASURED.read_text(encoding="utf-8"))
    script(data / "wheel_data.js", WHEEL_SCENE=lessons.scene(), WHEEL_MEASURED=measured)
    script(data / "ground_data.js", GROUND_DATA=lessons.on_the_ground())
    named = [f"{slug.replace('_', ' ').capitalize()} <{slug}>" for slug in slugs]
    write(source / "effects" / "index.md", CONTENTS, "Effects", [*named, "../own_effect"])


# Pictures of the first page: name -> chapter, and words of the cell that draws it.
FIRST = {
    "surveyor": ("00_quickstart", "compare_check_points("),
    "researcher": ("05c_published_survey", "drawings.beside_published("),
    "teacher": ("04b_bike_wheel", "classroom.wheel_page()"),
    "programmer": ("00_quickstart", "correlation_matrix("),
}
# Findings: chapter, words of the cell, and the finding.
GALLERY = (
    (
        "01_simulation", "focal length wrong by 50 px",
        "A focal length that is wrong by 50 px bends the ground where oblique images look at it.",
    ),
    (
        "03_thermal", "figures.thermal_parameters(",
        "A camera that warms up moves its picture by a pixel or two, and back as it cools.",
    ),
    (
        "04_rolling_shutter", "drawings.beside_published(",
        "Four published surveys beside their simulation: corrected they are better, not good.",
    ),
    (
        "05_missing_effect", "figures.counterpart(closing.before",
        "Residuals that look like noise: a shutter of 25 ms was hidden in them, and is found.",
    ),
    (
        "07_change", "figures.change_maps(",
        "What two dates changed, and what is more than the camera can explain.",
    ),
)  # fmt: skip


def first_page(source):
    """The first page: pictures of the chapters as executed, and the numbers that were measured."""
    path = source / "index.md"
    for name, (chapter, words) in FIRST.items():
        drawn(chapter, words, source / "pictures" / f"{name}.png")
    rows = []
    for number, (chapter, words, finding) in enumerate(GALLERY, 1):
        drawn(chapter, words, source / "pictures" / f"finding_{number}.png")
        rows.append(f"[{finding}](notebooks/{chapter}.ipynb)\n\n![{finding}]({path_of(number)})\n")
    text = path.read_text(encoding="utf-8")
    write_text(path, text.replace("EVIDENCE", evidence()).replace("GALLERY", "\n".join(rows)))


def path_of(number):
    """Where the picture of a finding lies, from the first page."""
    return f"pictures/finding_{number}.png"


def drawn(chapter, words, out):
    """Write the picture of the first cell that has these words and drew one."""
    content = json.loads((ROOT / "notebooks" / f"{chapter}.ipynb").read_text(encoding="utf-8"))
    for cell in content["cells"]:
        for output in cell.get("outputs", ()):
            png = output.get("data", {}).get("image/png")
            if png and words in "".join(cell["source"]):
                out.parent.mkdir(exist_ok=True)
                out.write_bytes(base64.b64decode(png))
                return
    raise SystemExit(f"{chapter}: no cell with {words!r} drew a picture; see docs/build.py")


def evidence():
    """A table: agreement in digits, rates on real noise and time beside Ceres, as measured."""
    digits = (DOCS / "digits.md").read_text(encoding="utf-8")
    printed, equal, agree, rows = re.search(
        r"Of ([\d,]+) printed numbers ([\d,]+) agree to the last digit; (\d+) of (\d+) rows", digits
    ).groups()
    rates = json.loads((DOCS / "guarantees.json").read_text(encoding="utf-8"))["flights"]
    times = json.loads((DOCS / "against_ceres.json").read_text(encoding="utf-8"))["sizes"]
    alone = "of 10 sigma, which the flight can tell from all others: named"
    asked = {
        "effects of ten sigmas that the flight can tell apart: named": alone,
        "effects of any size: named": "named, effects",
        "effects of any size: in the set that is named": "in the set that is named, effects",
        "wrong names": "wrong names beside hidden effects",
        "untouched parts of which something is said": "untouched blocks of which something is said",
    }
    lines = ["| question | answer | how it was measured |", "| --- | --- | --- |"]
    lines.append(
        f"| Does it compute what others compute? | {equal} of {printed} printed numbers agree to "
        f"the last digit, {agree} of {rows} rows within what both can say | "
        "[digits](digits.md): DBAT, pyBundleBlock, AICON |"
    )
    for number, (words, key) in enumerate(asked.items()):
        question = "" if number else "Is the diagnosis right? "
        lines.append(
            f"| {question}{words} | {rates[key]} | effects put into parts of a measured survey "
            "([guarantees](guarantees.md)) |"
        )
    for one in times:
        low, high = one["ratio_range"]
        lines.append(
            f"| Is it fast? {one['images']:,} images, {one['observations']:,} observations | "
            f"{one['ours_s']:.2f} s of processor, Ceres {one['ceres_s']:.2f} s: {one['ratio']:.0f} "
            f"times less ({low:.0f} to {high:.0f}) | `benchmarks/against_ceres.py`, same problem, "
            "same minimum |"
        )
    return "\n".join(lines)


def settings():
    """The numbers by which a diagnosis decides, and where they come from."""
    from corridor.diagnosis.settings import table

    return f"""# Numbers of a diagnosis

A diagnosis decides by these. `diagnosis.json` has those that were used;
`diagnose(settings=Settings(...))` takes others.

{table()}
"""


def folded(notebook):
    """A notebook whose code is behind a button: on the site one reads, in Jupyter one runs."""
    content = json.loads(notebook)
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            cell["metadata"].setdefault("tags", []).append("hide-input")
    return json.dumps(content)


def script(path, **values):
    """JavaScript that defines constants."""
    lines = (f"const {name} = {json.dumps(value)};" for name, value in values.items())
    write_text(path, "\n".join([*lines, ""]))


def section(title):
    """A section of the README, with links to folders of the repository as plain words."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = text.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    return title + "\n" + re.sub(r"\[([^]]+)\]\((data_synthetic/[^)]*)\)", r"`\2`", found)


def commands(path):
    """The command reference: what each verb's help prints."""
    from corridor.core import registry
    from corridor.interface import cli

    lines = ["# Commands", "", "What `corridor VERB --help` prints, verb by verb.", ""]
    os.environ["COLUMNS"] = "96"
    for name in registry.verbs():
        verbs = next(
            action
            for action in cli._parser(name)._actions
            if isinstance(action, argparse._SubParsersAction)
        )
        parser = verbs.choices[name]
        lines += [f"## {name}", "", "```text", parser.format_help().rstrip(), "```", ""]
        deeper = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        for action in deeper:
            for below, one in action.choices.items():
                lines += [
                    f"### {name} {below}",
                    "",
                    "```text",
                    one.format_help().rstrip(),
                    "```",
                    "",
                ]
    write_text(path, "\n".join(lines))


def api():
    """The package: what `corridor` offers, and each room."""
    import corridor

    offered = {name: getattr(corridor, name) for name in corridor.__all__}
    lines = ["# Python reference", "", "## corridor", ""]
    for name, what in offered.items():
        if inspect.isclass(what):
            lines.append(EVAL.format(f".. autoclass:: corridor.{name}\n   :members:"))
        elif inspect.isfunction(what):
            lines.append(EVAL.format(f".. autofunction:: corridor.{name}"))
    told = list(offered)
    for name, what in offered.items():
        if inspect.ismodule(what):
            # What several rooms offer stands where it is named first.
            shown = f"\n   :members:\n   :imported-members:\n   :exclude-members: {', '.join(told)}"
            lines += [f"## corridor.{name}", ""]
            lines.append(EVAL.format(f".. automodule:: corridor.{name}{shown}"))
            told += what.__all__
    return "\n".join(lines)


def write(path, form, title, entries):
    """A page that lists others."""
    write_text(path, form.format(title=title, entries="\n".join(entries)))


def write_text(path, text):
    """A text file, its folder made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
