"""Every number of a diagnosis has a source, and a diagnosis can be asked with another one."""

from dataclasses import fields

import pytest

from corridor.diagnosis.settings import SETTINGS, SOURCES, Settings, changed, table


def test_each_number_has_one_source():
    named = [name for names in SOURCES.values() for name in names.split()]
    assert sorted(named) == sorted(field.name for field in fields(Settings))


def test_the_table_has_them_all_with_their_values():
    text = table()
    assert "| `student_nu` | 4.0 | Heavy tails" in text
    assert text.count("\n") == 1 + len(fields(Settings))


def test_others_hold_for_a_while_and_no_unknown_one_is_taken():
    with changed(student_nu=5.0) as used:
        assert used.student_nu == SETTINGS.student_nu == 5.0
    assert SETTINGS.student_nu == Settings().student_nu
    with pytest.raises(AttributeError), changed(no_such_number=1.0):
        pass
