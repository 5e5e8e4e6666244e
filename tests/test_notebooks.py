"""The notebooks: paired, executed in order, and running from beginning to end."""

import json
import re
from pathlib import Path

import pytest
from kit import run_times

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
CHAPTERS = sorted(FOLDER.glob("*.py"))
# Of all fast forms together on two cores.
MOST_MINUTES = 12
MOST_OF_ONE = 3


def test_there_are_chapters():
    assert [path.stem for path in CHAPTERS][:1] == ["00_quickstart"]


def test_the_fast_forms_take_twelve_minutes_of_two_cores_and_none_more_than_three():
    """As they were measured: python -m kit.run_times --form fast, in notebooks/."""
    seconds = run_times.read()["fast_s"]
    assert list(seconds.index) == [path.stem for path in CHAPTERS]
    assert seconds.sum() <= 2 * 60 * MOST_MINUTES
    assert seconds.max() <= 60 * MOST_OF_ONE


def _parameters(chapter):
    """Names of the one cell that papermill may change."""
    notebook = json.loads(chapter.with_suffix(".ipynb").read_text(encoding="utf-8"))
    (cell,) = (
        "".join(c["source"])
        for c in notebook["cells"]
        if "parameters" in c["metadata"].get("tags", [])
    )
    return set(re.findall(r"^(\w+) = ", cell, flags=re.MULTILINE))


def shortened():
    """Chapters whose fast form is executed as well: those that write what `out` names, and leave
    out a quarter of their time.

    All are executed whole where their outputs are compared; `python -m kit.run_times` executes both
    forms of each.
    """
    seconds = run_times.read()
    left = seconds["fast_s"] < 0.75 * seconds["full_s"]
    return [one for one in CHAPTERS if "out" in _parameters(one) and left[one.stem]]


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda path: path.stem)
class TestEveryChapter:
    def test_both_files_of_the_pair_say_the_same(self, chapter):
        """If this fails: jupytext --sync notebooks/NAME.py, then execute the notebook again."""
        jupytext = pytest.importorskip("jupytext", reason="the extra 'notebooks' is not installed")
        script, notebook = jupytext.read(chapter), jupytext.read(chapter.with_suffix(".ipynb"))
        assert _told(script) == _told(notebook)

    def test_its_outputs_are_of_one_run_from_top_to_bottom(self, chapter):
        notebook = json.loads(chapter.with_suffix(".ipynb").read_text(encoding="utf-8"))
        counts = [c["execution_count"] for c in notebook["cells"] if c["cell_type"] == "code"]
        assert counts == list(range(1, len(counts) + 1))

    def test_its_outputs_name_no_path_of_this_machine_and_no_warning(self, chapter):
        notebook = json.loads(chapter.with_suffix(".ipynb").read_text(encoding="utf-8"))
        outputs = [output for c in notebook["cells"] for output in c.get("outputs", [])]
        assert not [o for o in outputs if o.get("name") == "stderr"]
        text = json.dumps(
            [
                {k: v for k, v in o.get("data", {}).items() if not k.startswith("image/")}
                | {"text": o.get("text")}
                for o in outputs
            ]
        )
        assert str(Path.home()) not in text and str(FOLDER.parent) not in text

    def test_it_has_the_parameters_that_every_chapter_has(self, chapter):
        for name in ("fast", "seed"):
            assert name in _parameters(chapter)

    def test_every_parameter_is_used(self, chapter):
        """`papermill -p NAME VALUE` must change something; `fast` may have nothing to leave out."""
        code = "\n".join(
            line
            for line in chapter.read_text(encoding="utf-8").splitlines()
            if not line.startswith("#")
        )
        for name in _parameters(chapter) - {"fast", "seed"}:
            assert len(re.findall(rf"\b{name}\b", code)) > 1, name

    def test_its_top_says_how_long_it_runs(self, chapter):
        """If this fails: say at the top what `kit.run_times.sentence` says."""
        assert f"\n# {run_times.sentence(chapter.stem)}\n" in chapter.read_text(encoding="utf-8")

    def test_it_deletes_nothing(self, chapter):
        """`out` may name any folder of the reader's; what writes there replaces only its own."""
        for word in ("rmtree", "rmdir", "unlink", "os.remove"):
            assert word not in chapter.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("chapter", shortened(), ids=lambda path: path.stem)
def test_it_runs_in_its_fast_form(chapter, tmp_path):
    papermill = pytest.importorskip("papermill", reason="the extra 'notebooks' is not installed")
    papermill.execute_notebook(
        chapter.with_suffix(".ipynb"),
        tmp_path / f"{chapter.stem}.ipynb",
        parameters={"fast": True}
        | ({"out": str(tmp_path / "out")} if "out" in _parameters(chapter) else {}),
        cwd=str(FOLDER),
        kernel_name="python3",
        progress_bar=False,
    )


def _told(notebook):
    return [(cell.cell_type, cell.source.strip()) for cell in notebook.cells]


def test_chapters_and_kit_need_nothing_that_an_installed_corridor_lacks():
    """`benchmarks` is no part of the package: only a command of the kit may import it, when run."""
    for path in [*CHAPTERS, *sorted((FOLDER / "kit").glob("*.py"))]:
        lines = path.read_text(encoding="utf-8").splitlines()
        assert not [line for line in lines if re.match(r"(from|import) benchmarks", line)], path
