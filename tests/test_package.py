"""What `import corridor` offers: a function for each command, and what one types first."""

import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import corridor
import corridor.interface.cli
from corridor.core.effects import every_effect

DIKE = Path(__file__).parents[1] / "data_synthetic" / "dike"


def test_every_command_has_a_function_or_a_room():
    """A verb of several functions is a room of its own name."""
    # Verb -> what stands for it where it cannot bear its name, or is no part of the package.
    other = {"import": "import_project", "benchmark-diagnosis": None}
    for module in pkgutil.iter_modules(corridor.cli.__path__):
        verb = module.name.rstrip("_").replace("_", "-")
        name = other.get(verb, verb)
        if module.name.startswith("_") or name is None:
            continue
        assert name in dir(corridor), verb
        assert getattr(corridor, name).__doc__


def test_dir_shows_nothing_that_is_no_function_type_or_room_of_a_user():
    shown = set(dir(corridor))
    assert not {"TYPE_CHECKING", "import_module", "warnings", "diagnosis", "simulation"} & shown
    for name in shown:
        assert getattr(corridor, name) is not None


@pytest.mark.parametrize("room", ["diagnosis", "interchange", "planning", "preparation"])
def test_rooms_behind_a_function_are_there_when_asked_for(room):
    assert getattr(corridor, room).__name__ == f"corridor.{room}"


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
