"""What a type checker and an editor are told of `import corridor`."""

import sys
from pathlib import Path

import pytest

import corridor

ROOT = Path(__file__).resolve().parents[1]


def test_the_stub_is_what_the_functions_say(monkeypatch):
    """Else a checker would refuse an option that there is: `python docs/stub.py` writes it anew."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    import stub

    assert stub.STUB.read_text(encoding="utf-8") == stub.text()


def test_the_package_says_that_it_has_types():
    assert (Path(corridor.__file__).parent / "py.typed").is_file()


USER = """\
import corridor

block: corridor.Block = corridor.read("data_synthetic/dike")
adjustment = corridor.adjust(block, effects="gnss_bias", camera="f,cx,cy")
value: float = adjustment.parameters["gnss_bias.z"].value
print(adjustment.check_points, adjustment.sigma_naught == adjustment.sigma0, value)
diagnosis: corridor.Diagnosis = corridor.diagnose(block)
print(diagnosis.sentence)
corridor.simulate("thesis_50vt", seed=1)
planned = corridor.plan("thesis_50vt+thesis_50ob", control=[0, 1, 5])
print(planned.advice)
found = corridor.change("a", "b", same_ties=True)
print(corridor.change.verdict_sentence(found))
try:
    corridor.batch("adjust", ["a"], "out")
except corridor.CorridorError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """What mypy remembers of modules: all questions are asked of the same ones."""
    return str(tmp_path_factory.mktemp("kept"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "wrong"),
    [
        (USER, ""),
        (
            "import corridor\ncorridor.adjust('a', camra='f')\n",
            'keyword argument "camra"',
        ),
        ("import corridor\ncorridor.adjust('a').no_such\n", 'no attribute "no_such"'),
    ],
    ids=["a user's script", "an option that there is not", "a result that there is not"],
)
def test_mypy_understands_a_users_script(script, wrong, tmp_path, kept):
    api = pytest.importorskip("mypy.api", reason="mypy is not installed")
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    words = ["--ignore-missing-imports", "--follow-imports", "silent", "--no-error-summary"]
    told, fault, status = api.run(
        [*words, "--python-executable", sys.executable, "--cache-dir", kept,
         str(tmp_path / "script.py")]
    )  # fmt: skip
    assert not fault
    assert (status, told) == (0, "") if not wrong else wrong in told


@pytest.mark.slow
def test_mypy_finds_no_error_in_the_core(kept):
    """Kernels that numba types are left out, as pyproject.toml says."""
    api = pytest.importorskip("mypy.api", reason="mypy is not installed")
    told, fault, status = api.run(
        ["--config-file", str(ROOT / "pyproject.toml"), "--follow-imports", "silent",
         "--python-executable", sys.executable, "--cache-dir", kept,
         str(ROOT / "corridor" / "core")]
    )  # fmt: skip
    assert not fault
    assert status == 0, told
