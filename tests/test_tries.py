"""What newcomers type, in short form: each try ends as `benchmarks.tries` says it has to."""

import pytest

from benchmarks.tries import made
from benchmarks.tries.listed import TRIES
from benchmarks.tries.running import Try, judged

# What is refused is refused in a tenth of a second; what works takes a second and more.
SHORT = [one for one in TRIES if one.status == 2 and not one.long]
MORE = [one for one in TRIES if one.status != 2 and not one.long]


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tries") / "world"
    made.make(folder, short=True)
    return folder


def test_numbers_are_different_and_there_are_many():
    assert len({one.number for one in TRIES}) == len(TRIES) > 170


@pytest.mark.parametrize("one", SHORT, ids=lambda one: one.number)
def test_a_wrong_input_is_answered_as_it_has_to_be(one, world, tmp_path):
    found = judged(one, world, tmp_path / "out")
    assert not found.fault, f"{one.words}\n{found.text}"


@pytest.mark.slow
@pytest.mark.parametrize("one", MORE, ids=lambda one: one.number)
def test_a_right_input_is_answered_as_it_has_to_be(one, world, tmp_path):
    found = judged(one, world, tmp_path / "out")
    assert not found.fault, f"{one.words}\n{found.text}"


@pytest.mark.parametrize(
    ("one", "fault"),
    [
        (Try("a", "effects", 2), "status 0 in place of 2"),
        (Try("b", "effects", 0, "a chapter on ripples"), "does not say"),
        (Try("c", "effects", 0, "", "rolling_shutter"), "says 'rolling_shutter'"),
    ],
)
def test_a_bad_answer_is_bad(one, fault, tmp_path):
    assert fault in judged(one, tmp_path, tmp_path / "out").fault
