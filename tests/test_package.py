"""What `import corridor` offers: a function for each command, and what one types first."""

import ast
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

import corridor
from corridor.core import registry
from corridor.core.effects import every_effect

ROOT = Path(__file__).parents[1]
DIKE = ROOT / "data_synthetic" / "dike"


def test_every_command_has_a_function_or_a_room():
    """A verb of several functions is a room of its own name."""
    # Verb -> what stands for it where it cannot bear its name.
    other = {"import": "import_project", "check": "check_project", "report-bug": "report_bug"}
    for verb in registry.verbs():
        name = other.get(verb, verb)
        assert name in dir(corridor), verb
        assert getattr(corridor, name).__doc__


def test_dir_shows_nothing_that_is_no_function_type_or_room_of_a_user():
    shown = set(dir(corridor))
    assert not {"TYPE_CHECKING", "import_module", "warnings", "diagnosis", "simulation"} & shown
    for name in shown:
        assert getattr(corridor, name) is not None


@pytest.mark.parametrize(
    ("room", "home"),
    [
        ("diagnosis", "diagnosis"),
        ("interchange", "tools.formats"),
        ("formats", "tools.formats"),
        ("planning", "tools.planning"),
        ("preparation", "core.preparation"),
        ("report", "interface.report"),
    ],
)
def test_rooms_are_there_by_their_public_names_wherever_they_stand(room, home):
    assert getattr(corridor, room).__name__ == f"corridor.{home}"
    assert import_module(f"corridor.{room}") is import_module(f"corridor.{home}")


def test_a_file_of_a_room_is_one_module_under_either_name():
    """Else a class would be two, and `isinstance` wrong."""
    public = import_module("corridor.effects.contract")
    assert public is import_module("corridor.core.effects.contract")
    assert public.__spec__.name == "corridor.core.effects.contract"


def test_what_is_no_room_is_not_there():
    with pytest.raises(ModuleNotFoundError, match="nonsense"):
        import_module("corridor.nonsense")
    with pytest.raises(AttributeError, match="nonsense"):
        corridor.nonsense  # noqa: B018


def test_importing_it_loads_no_numerical_library():
    program = "import corridor, sys; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


def test_summary_takes_a_path_and_names_what_the_effects_lack():
    found = corridor.summary(DIKE)
    assert found.name == "dike" and "images.temperature_c" not in found.missing
    assert set(found.untestable) <= {effect.slug for effect in every_effect()}
    assert str(found) == str(corridor.summary(corridor.read(DIKE)))


def test_an_effect_shows_its_slug_and_title():
    (one,) = corridor.Model(effects="gnss_bias").effects
    assert repr(one) == f"Effect gnss_bias: {one.title}"
    assert "of each flight" in repr(corridor.effects.find("gnss_bias@flight"))


@pytest.mark.parametrize("call", [corridor.simulate, corridor.plan])
@pytest.mark.parametrize("given", [3, {"height": 50}, None])
def test_what_is_no_plan_is_refused_in_a_sentence(call, given):
    with pytest.raises(corridor.InputError, match="a plan is a .toml file"):
        call(given)


@pytest.mark.parametrize("call", [corridor.read, corridor.adjust, corridor.diagnose])
@pytest.mark.parametrize("given", [3, None, {"dike": 1}])
def test_what_is_no_block_is_refused_in_a_sentence(call, given):
    with pytest.raises(corridor.InputError, match="a block is a folder"):
        call(given)


def test_a_camera_of_one_number_is_refused_and_told_how_to_be_made():
    with pytest.raises(corridor.InputError, match=r"write Camera.from_table\('phone'"):
        corridor.Camera("phone", 1600, 1200, 1500.0)
    made = corridor.Camera.from_table("phone", {"width": 1600, "height": 1200, "f": 1500.0})
    assert made["f"] == 1500.0


def test_words_of_the_code_in_the_glossary_are_words_of_the_code():
    """A name that is changed in one place and not in the other leads nowhere."""
    text = (ROOT / "docs" / "pages" / "glossary.md").read_text(encoding="utf-8")
    told = re.findall(r"\(([^()]*) in the code", text)
    named = {word for words in told for word in re.findall(r"`(\w+)`", words)}
    files = (ROOT / "corridor").rglob("*.py")
    used = set(re.findall(r"\w+", " ".join(file.read_text(encoding="utf-8") for file in files)))
    assert len(named) > 3 and named <= used


def test_every_import_finds_its_name():
    """Also those inside functions, which nobody meets before the function is called."""
    lost = []
    for file in (ROOT / "corridor").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("corridor"):
                room = import_module(node.module)
                for name in (one.name for one in node.names):
                    inside = hasattr(room, "__path__") and find_spec(f"{node.module}.{name}")
                    if not (hasattr(room, name) or inside):
                        lost.append(f"{file.relative_to(ROOT)}, line {node.lineno}: {name}")
    assert lost == []
