"""Where nothing can be written, that is said before any work, and with the name that was typed."""

import pytest

import corridor
from corridor.interface.cli import main


class TestWhereNothingCanBeWritten:
    """It is said before any work, and with the name that was typed."""

    @pytest.mark.parametrize("verb", ["adjust", "diagnose", "summary"])
    def test_no_permission(self, sound, tmp_path, capsys, monkeypatch, verb):
        monkeypatch.setattr("os.access", lambda *_, **__: False)
        assert main([verb, str(sound), "-o", str(tmp_path / "out")]) == 1
        last = capsys.readouterr().err.splitlines()[-1]
        assert last == f"failed: {tmp_path}: no permission to write there; nothing was written."

    def test_no_free_place(self, sound, tmp_path, capsys, monkeypatch):
        usage = type("Usage", (), {"free": 1000})
        monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
        assert main(["summary", str(sound), "-o", str(tmp_path / "out")]) == 1
        assert "no free place on this disk" in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []

    def test_hidden_names_are_not_told(self, sound, tmp_path, capsys, monkeypatch):
        def refused(self, *_, **__):
            hidden = str(tmp_path / ".out.0123abcd.part" / "x.csv")
            raise PermissionError(13, "Permission denied", hidden)

        monkeypatch.setattr(corridor, "read", refused)
        assert main(["adjust", str(sound), "-o", str(tmp_path / "out")]) == 1
        assert f"failed: {tmp_path / 'out' / 'x.csv'}: Perm" in capsys.readouterr().err
