"""A verb and a format that another package brings, found by its entry points alone."""

import sys
import textwrap

import pytest

import corridor
from corridor.core import registry
from corridor.interface.cli import main
from corridor.tools.formats import programs

VERB = '''
    """Count the images of a block.

    examples:
      corridor count BLOCK
    """
    OPTIONS = {"block": {}}


    def run(options):
        from corridor.core.block import read

        print(len(read(options.block).images), "images")
'''
FORMAT = '''
    """Blocks that lie under another name, as a stranger's program leaves them."""
    import shutil
    from corridor.core.block import read as read_block
    from corridor.tools.formats import Project

    NAME, TITLE = "elsewhere", "a block in a folder of another program"


    def recognise(path):
        return (path / "elsewhere.txt").is_file()


    def read(path, size=None):
        return Project(form=NAME, source=path, block=read_block(path / "kept"))
'''


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package as pip leaves it: two modules, and the entry points in its metadata."""
    place = tmp_path / "site"
    folder = place / "stranger-1.0.dist-info"
    folder.mkdir(parents=True)
    (place / "stranger_verb.py").write_text(textwrap.dedent(VERB))
    (place / "stranger_format.py").write_text(textwrap.dedent(FORMAT))
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        "[corridor.verbs]\ncount = stranger_verb\nadjust = stranger_verb\n"
        "[corridor.formats]\nelsewhere = stranger_format\nbroken = stranger_nothing\n"
    )
    monkeypatch.syspath_prepend(str(place))

    def forget():
        registry.verbs.cache_clear()
        programs.formats.cache_clear()

    forget()
    yield
    monkeypatch.undo()
    forget()
    for name in ("stranger_verb", "stranger_format"):
        sys.modules.pop(name, None)


def test_a_verb_is_listed_explained_and_run(installed, capsys):
    with pytest.warns(UserWarning, match="verb adjust of stranger_verb is left out"):
        assert main(["count", "data_synthetic/dike"]) == 0
    assert capsys.readouterr().out == f"{len(corridor.read('data_synthetic/dike').images)} images\n"
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "count the images of a block" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["count", "--help"])
    assert "corridor count BLOCK" in capsys.readouterr().out


def test_a_format_is_recognised_imported_and_proved(installed, tmp_path, capsys):
    adjusted = corridor.adjust("data_synthetic/dike").block
    adjusted.write(tmp_path / "project" / "kept")
    (tmp_path / "project" / "elsewhere.txt").write_text("theirs")
    with pytest.warns(UserWarning, match="broken of stranger_nothing: cannot be loaded"):
        assert main(["import", "auto", str(tmp_path / "project"), "-o", str(tmp_path / "b")]) == 0
    assert len(corridor.read(tmp_path / "b").images) == len(adjusted.images)
    assert "px" in capsys.readouterr().out
