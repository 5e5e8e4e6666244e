"""The page: the template executed as a notebook, its outputs put together without their code."""

from __future__ import annotations

import os
import pickle
import signal
import tempfile
from concurrent.futures import ThreadPoolExecutor
from html import escape
from pathlib import Path

from corridor.diagnosis.report.contents import Contents
from corridor.errors import AdjustmentFailed

TEMPLATE = Path(__file__).with_name("template.py")
TIMEOUT_S = 600

_STYLE = """
body {margin: 2.2em auto; padding: 0 1.2em; max-width: 68em; color: #222; background: #fff;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif}
h1 {font-size: 1.35em; font-weight: 600; margin: 0 0 .6em}
h2 {font-size: 1.1em; font-weight: 600; margin: 2.2em 0 .3em}
p {margin: .4em 0; max-width: 50em}
p.sentence {font-size: 1.3em; line-height: 1.4; border-left: 4px solid #004488;
  padding: .2em 0 .2em .8em; margin: .6em 0 1em}
p.note {border-left: 3px solid #ddaa33; padding: .1em 0 .1em .7em}
img {max-width: 100%; height: auto; display: block; margin: .8em 0}
div.wide {overflow-x: auto}
table {border-collapse: collapse; margin: .8em 0; font-size: 14px}
th, td {padding: .18em 1.2em .18em 0; text-align: left; vertical-align: top; max-width: 30em}
th {font-weight: 400; color: #555; border-bottom: 1px solid #999}
.number {text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums}
pre {background: #f4f4f4; padding: .6em .8em; overflow-x: auto}
@media print {body {margin: 0; max-width: none} img, tr {break-inside: avoid}}
""".strip()


def make_page(contents: Contents, pictures: Path) -> str:
    """The page as HTML that needs no other file; its pictures go to a folder as well."""
    import jupytext

    with tempfile.TemporaryDirectory(prefix="corridor-") as folder:
        work = Path(folder)
        (work / "contents.pickle").write_bytes(pickle.dumps(contents))
        notebook = jupytext.read(TEMPLATE)
        _set_parameters(
            notebook, contents=str(work / "contents.pickle"), pictures=str(pictures.resolve())
        )
        _execute(notebook, work)
    return _html(notebook, contents.name)


def _set_parameters(notebook, **values: str) -> None:
    """Gives the cell tagged `parameters` other values, as papermill does."""
    for cell in notebook.cells:
        if "parameters" in cell.metadata.get("tags", []):
            cell.source += "\n" + "\n".join(f"{k} = {v!r}" for k, v in values.items())


def _execute(notebook, work: Path) -> None:
    """Runs all cells in a kernel of this very Python, apart from the reader's own settings."""
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError, DeadKernelError
    from traitlets.config import Config

    # No kernel that some other Python has installed under the same name.
    config = Config({"KernelSpecManager": {"kernel_dirs": []}})
    config.KernelManager.connection_file = str(work / "kernel.json")
    if os.name != "nt":
        # Sockets in the folder need no port; Windows has none.
        config.KernelManager.transport, config.KernelManager.ip = "ipc", str(work / "kernel")
    client = NotebookClient(
        notebook,
        kernel_name="python3",
        timeout=TIMEOUT_S,
        resources={"metadata": {"path": str(work)}},
        extra_arguments=["--HistoryManager.enabled=False"],
        config=config,
    )
    here = str(Path(__file__).resolve().parents[3])
    before = os.environ.get("PYTHONPATH")
    environment = os.environ | {
        "PYTHONPATH": here if not before else os.pathsep.join([here, before]),
        "IPYTHONDIR": str(work / "ipython"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        "MPLBACKEND": "agg",
    }
    # In a thread of its own nbclient leaves the signals alone, and Ctrl-C is ours to answer.
    with (work / "kernel.log").open("w+") as log, ThreadPoolExecutor(1) as pool:
        job = pool.submit(client.execute, env=environment, stderr=log)
        try:
            job.result()
        except KeyboardInterrupt:
            if client.km is not None and client.km.provisioner is not None:
                os.kill(client.km.provisioner.pid, signal.SIGTERM)
            raise
        except (CellExecutionError, DeadKernelError, RuntimeError) as failed:
            log.seek(0)
            said = [line for line in f"{log.read()}\n{failed}".splitlines() if line.strip()]
            raise AdjustmentFailed(f"the report could not be made: {said[-1]}") from failed


def _html(notebook, name: str) -> str:
    """Outputs of the code cells between the headings; one without anything below it is left out."""
    from markdown_it import MarkdownIt

    title = escape(f"Diagnosis of {name}")
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        '<head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{title}</title>",
        f"<style>{_STYLE}</style></head>",
        "<body>",
    ]
    heading = ""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            heading = MarkdownIt().render(cell.source)
            continue
        shown = [text for output in cell.get("outputs", []) if (text := _output(output))]
        if shown:
            parts += [heading, *shown]
        heading = ""
    parts.append("</body></html>\n")
    return "\n".join(part for part in parts if part)


def _output(output) -> str:
    data = output.get("data", {})
    if "image/png" in data:
        alt = output.get("metadata", {}).get("image/png", {}).get("alt", "picture")
        code = "".join(data["image/png"].split())
        return f'<img alt="{escape(alt)}" src="data:image/png;base64,{code}">'
    return data.get("text/html", "")
