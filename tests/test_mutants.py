"""The mutants that the guarantees count stand in the source as it is now."""

from benchmarks.guarantees import mutants


def test_every_mutant_has_its_place_and_changes_it():
    assert not mutants.misplaced()
    assert all(one.old != one.new for one in mutants.MUTANTS)
    assert len({(one.file, one.old, one.new) for one in mutants.MUTANTS}) == len(mutants.MUTANTS)


def test_every_mutant_names_tests_that_are_there():
    for one in mutants.MUTANTS:
        assert all((mutants.ROOT / name).is_file() for name in one.tests.split())
