"""An effect from outside the package is an effect like any other."""

import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from strips import corridor_block

import corridor
from corridor.core.effects import (
    LinearEffect,
    Parameter,
    Values,
    add,
    correct,
    every_effect,
    find,
    forget,
    parse_word,
    register,
    registry,
)
from corridor.core.simulation import add_noise
from corridor.interface.cli import main

AMPLITUDE = 1.5  # px


class Ripple(LinearEffect):
    """A window of uneven glass in front of the lens: three waves over the picture."""

    slug = "ripple"
    title = "Waves over the picture, as of uneven glass"
    called = "a ripple of the picture"
    place = "image"
    group = "camera"
    revealed_by = "many tie points over all of the picture"
    unobservable_when = "points lie where the wave is level"

    def parameters(self, block):
        return [Parameter("amplitude", "px", scale=1.0, text="height of the waves")]

    def derivative(self, context):
        """dx = amplitude sin(3 pi x), x from -1 to 1 over the picture."""
        derivative = np.zeros((len(context), 2, 1))
        derivative[:, 0, 0] = np.sin(3 * np.pi * context.plane[:, 0])
        return derivative


@pytest.fixture(scope="module")
def plain():
    return corridor_block(images=24, strips=2, observations_per_image=160, seed=5)


def pixels(block):
    return block.tie_points[["x", "y"]].to_numpy()


def seen_through(block, effect):
    """The block with the effect, 0.3 px of noise in the picture and 2 cm of the GNSS."""
    return add_noise(
        add(block, {effect: {"amplitude": AMPLITUDE}}),
        tie_px=0.3,
        mark_px=0.3,
        gnss_m=0.02,
        control_m=0.01,
        seed=7,
    )


def holds(found):
    """Estimated within four sigmas, and clearly."""
    one = found.parameters["ripple.amplitude"]
    assert one.unit == "px" and one.vary
    assert abs(one.value - AMPLITUDE) < 4 * one.sigma < 0.1 * AMPLITUDE


class TestOneThatIsGivenAsItIs:
    def test_is_adjusted_and_corrected(self, plain):
        flown = seen_through(plain, Ripple())
        found = corridor.adjust(flown, camera="fixed", effects=[Ripple()])
        holds(found)
        clean = correct(found.block, found.values)
        assert clean.extra["corrected"]["ripple"]["amplitude"] == pytest.approx(AMPLITUDE, rel=0.05)
        moved = np.abs(pixels(clean) - pixels(flown)).max()
        assert moved == pytest.approx(AMPLITUDE, rel=0.05)
        again = corridor.adjust(clean, camera="fixed", effects=[Ripple()])
        assert abs(again.parameters["ripple.amplitude"].value) < 0.01

    def test_is_simulated(self):
        flown = corridor.simulate("thesis_50vt", {Ripple(): {"amplitude": AMPLITUDE}}, seed=1)
        plain = corridor.simulate("thesis_50vt", seed=1)
        assert np.abs(pixels(flown) - pixels(plain)).max() == pytest.approx(AMPLITUDE, rel=0.01)
        assert flown.truth["effects"] == {"ripple": {"amplitude": AMPLITUDE}}

    @pytest.mark.slow
    def test_is_part_of_what_a_diagnosis_believes(self, plain):
        flown = seen_through(plain, Ripple())
        found = corridor.diagnose(flown, camera="fixed", effects=[Ripple()])
        assert found.verdict in ("nothing", "suspected")
        assert "ripple" in found.before.values
        assert str(found)


class TestOneThatIsRegistered:
    @pytest.fixture(autouse=True)
    def known(self):
        register(Ripple)
        yield
        forget("ripple")

    def test_has_its_slug_everywhere(self, plain, capsys):
        assert find("ripple@flight").group == "flight"
        assert "ripple" in {effect.slug for effect in every_effect()}
        assert main(["effects", "ripple"]) == 0
        assert "uneven glass" in capsys.readouterr().out
        flown = add(plain, {"ripple": {"amplitude": 1.0}})
        assert np.abs(pixels(flown) - pixels(plain)).max() == pytest.approx(1.0, rel=0.01)

    @pytest.mark.slow
    def test_is_named_by_a_diagnosis(self, plain):
        found = corridor.diagnose(seen_through(plain, "ripple"), camera="fixed")
        assert found.verdict == "named"
        (one,) = found.effects
        assert one["slug"] == "ripple"
        assert one["parameters"][0]["value"] == pytest.approx(AMPLITUDE, rel=0.1)
        assert "ripple" in str(found)

    def test_a_slug_of_the_catalogue_is_refused(self):
        class Thermal(Ripple):
            slug = "thermal"

        with pytest.raises(corridor.InputError, match="thermal is there already"):
            register(Thermal)


class TestOneThatIsNone:
    """The class is looked at before it is used, and what it lacks is said."""

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"place": "picture"}, "place = 'picture' is unknown.* camera, image, motion, antenna"),
            ({"place": "images"}, "did you mean image"),
            ({"title": ""}, "has no title: write title = "),
            ({"called": None}, "has no called"),
            ({"slug": "My Ripple"}, "lower case"),
            ({"group": "week"}, "group = 'week' is unknown"),
            ({"needs": "images.time_s"}, "needs is a tuple"),
        ],
    )
    def test_is_refused_with_what_it_lacks(self, changes, words):
        with pytest.raises(corridor.InputError, match=words):
            register(type("Broken", (Ripple,), changes))

    def test_so_is_a_class_that_is_no_effect(self):
        with pytest.raises(corridor.InputError, match="Plain is not an effect: derive it"):
            register(type("Plain", (), {"slug": "plain"}))

    def test_its_unknowns_may_be_declared_and_are_demanded(self, plain):
        class Declared(Ripple):
            unknowns = [Parameter("amplitude", "px", scale=1.0)]
            parameters = LinearEffect.parameters

        class Empty(Declared):
            unknowns = ()

        assert Declared().parameters(plain) == Declared.unknowns
        with pytest.raises(corridor.InputError, match="Empty has no parameters: list them"):
            register(Empty)

    @pytest.mark.parametrize(
        ("shape", "words"),
        [
            ((2,), r"derivative has the shape \(\d+, 2\); the place image wants"),
            ((3, 1), r"derivative has the shape \(\d+, 3, 1\)|shift has the shape \(\d+, 3\)"),
        ],
    )
    def test_so_are_results_of_another_shape(self, plain, shape, words):
        class Flat(Ripple):
            def shift(self, context, values):
                return np.zeros((len(context), 2)), np.zeros((len(context), *shape))

        with pytest.raises(corridor.InputError, match=words):
            corridor.effects.predict(plain, {Flat(): {"amplitude": 1.0}})


def test_values_of_one_flight_are_given_in_the_command():
    """`lag.2=0.06` is of flight 2 alone."""
    word = "clock_offset@flight:offset.F1=0.0,offset.F2=0.06"
    block = corridor_block(images=8, strips=2, flights=2, seed=5)
    moved = add(block, dict([parse_word(word)]))
    there, here = (one.gnss[["x", "y", "z"]].to_numpy() for one in (moved, block))
    away = np.linalg.norm(there - here, axis=1)
    second = block.image_flight == 1
    assert away[~second].max() == 0.0 and away[second].min() > 0.01


STRANGER = '''
    """Uneven glass. Source: a stranger's package."""
    import numpy as np
    from corridor.core.effects import LinearEffect, Parameter


    class Glass(LinearEffect):
        slug = "glass"
        title = "Waves over the picture"
        called = "a ripple of the picture"
        place = "image"

        def parameters(self, block):
            return [Parameter("amplitude", "px", scale=1.0)]

        def derivative(self, context):
            """dx = amplitude sin(3 pi x)."""
            derivative = np.zeros((len(context), 2, 1))
            derivative[:, 0, 0] = np.sin(3 * np.pi * context.plane[:, 0])
            return derivative
'''


class TestOneOfAnotherPackage:
    @pytest.fixture
    def installed(self, tmp_path, monkeypatch):
        """A package as pip leaves it: a module, and the entry points in its metadata."""
        (tmp_path / "stranger.py").write_text(textwrap.dedent(STRANGER))
        folder = tmp_path / "stranger-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
        points = "[corridor.effects]\nglass = stranger:Glass\nbroken = stranger:Nothing\n"
        (folder / "entry_points.txt").write_text(points)
        monkeypatch.syspath_prepend(str(tmp_path))
        registry.forget_installed()
        with pytest.warns(UserWarning, match="broken of stranger:Nothing cannot be loaded"):
            every_effect()
        yield
        sys.modules.pop("stranger", None)
        monkeypatch.undo()
        registry.forget_installed()

    def test_is_simulated_adjusted_corrected_and_diagnosed(self, plain, installed, tmp_path):
        flown = seen_through(plain, "glass")
        flown.write(tmp_path / "flown")
        found = corridor.adjust(flown, camera="fixed", effects=["glass"])
        found.save(tmp_path / "result")
        told = Values.read(tmp_path / "result" / "adjustment.json", flown)
        assert told["glass"]["amplitude"] == pytest.approx(AMPLITUDE, rel=0.1)
        command = ["correct", str(tmp_path / "result" / "block"), "--effect", "glass"]
        source = ["--from", str(tmp_path / "result" / "adjustment.json")]
        assert main([*command, *source, "-o", str(tmp_path / "clean")]) == 0
        moved = pixels(corridor.read(tmp_path / "clean")) - pixels(flown)
        assert np.abs(moved).max() == pytest.approx(AMPLITUDE, rel=0.1)
        only = ["glass", "sensor_unflatness", "radial_distortion"]
        (one,) = corridor.diagnose(flown, camera="fixed", only=only).effects
        assert one["slug"] == "glass"


def test_the_example_of_the_readme_is_one():
    text = (Path(__file__).parents[3] / "README.md").read_text(encoding="utf-8")
    code = next(part for part in text.split("```") if "@register" in part)
    exec(code.removeprefix("python\n"), {})
    try:
        block = corridor_block(images=4, strips=1)
        moved = pixels(add(block, {"ripple": {"amplitude": 1.0}})) - pixels(block)
        assert 0.9 < np.abs(moved).max() <= 1.01
    finally:
        forget("ripple")


class Runaway(Ripple):
    """A shape that leaves all numbers behind, to both sides."""

    slug = "runaway"

    def derivative(self, context):
        """Infinite: to the right in one half of the rows, to the left in the other."""
        out = np.full((len(context), 2, 1), np.inf)
        out[::2] = -np.inf
        return out


def test_a_shape_that_is_infinite_ends_in_a_sentence_that_names_an_image():
    block = corridor_block(images=8, strips=1, control=4, check=0)
    with pytest.raises(corridor.AdjustmentFailed, match="not a number at image .*far outside"):
        corridor.adjust(block, effects=[Runaway()])
