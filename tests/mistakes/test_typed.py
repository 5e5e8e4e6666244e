"""What is typed wrong ends in one sentence that says what to do, and leaves nothing behind."""

import re
import shlex

import pytest
from typed import VERBS

from corridor.interface.cli import main

ROWS = [(verb, *row) for verb, rows in VERBS.items() for row in rows]


@pytest.mark.parametrize(("verb", "typed", "status", "words"), ROWS, ids=[r[1] for r in ROWS])
def test_ends_in_a_sentence(places, tmp_path, capsys, monkeypatch, verb, typed, status, words):
    before = {path.name for path in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    arguments = [
        re.sub(r"\b[A-Z]{3,}\b", lambda word: str(places.get(word[0], word[0])), word)
        for word in shlex.split(typed)
    ]
    try:
        ended = main(arguments)
    except SystemExit as stop:
        ended = stop.code
    said = capsys.readouterr().err
    assert ended == status, said
    last = said.splitlines()[-1]
    assert re.search(words, last), last
    assert len(last) < 600 and "Traceback" not in said
    assert {path.name for path in tmp_path.iterdir()} == before
