"""`rambler update`: arguments, exit codes and errors; the update itself is in install/test_update.py."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import update as command
from firmware_py.install.bundle import UpdateError
from firmware_py.install.update import Permissions


@pytest.fixture
def update(monkeypatch, tmp_path, capsys):
    """Return a function that runs the command with fake steps; the result is exit code, error and calls."""
    monkeypatch.setattr(command, "SIGNERS", tmp_path / "signers")

    def run(*words, blocked_reason="", error=None, passed=True):
        calls, installation = [], SimpleNamespace(blocked_reason=blocked_reason)

        def step(*arguments):
            calls.append(arguments[1:-1])
            if error is not None:
                raise error

        monkeypatch.setattr(command, "read_installation", lambda unit: calls.append(unit) or installation)
        monkeypatch.setattr(command, "roll_back", step)
        monkeypatch.setattr(command, "update", step)
        monkeypatch.setattr(command, "await_trial", lambda _installation, report: report("ready") or passed)
        code = main(["update", *words])
        output = capsys.readouterr()
        assert output.out == ("ready\n" if code != 2 else "")
        return code, output.err, calls

    return run


def test_bundle_is_checked_with_the_signers_that_exist(update, tmp_path):
    unit, none = Path("/etc/systemd/system/rambler.service"), Permissions(armed=False, older=False)
    assert update("a.bundle") == (0, "", [unit, (Path("a.bundle"), None, none)])
    assert update("a.bundle", passed=False)[0] == 1
    assert update("--back", "--unit", "u") == (0, "", [Path("u"), (none,)])
    (tmp_path / "signers").symlink_to("nowhere")  # a dangling link must not permit any bundle
    assert update("a.bundle", "--armed")[2][1] == (
        Path("a.bundle"),
        tmp_path / "signers",
        Permissions(True, older=False),
    )
    words = ("a.bundle", "--signers", "s", "--older")
    assert update(*words)[2][1] == (Path("a.bundle"), Path("s"), Permissions(armed=False, older=True))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"blocked_reason": "mask"}, "mask"),
        ({"error": UpdateError("no bundle")}, "no bundle"),
        ({"error": OSError(28, "full", "/opt")}, "/opt: full; the installed version is unchanged"),
        ({"error": OSError(28, "full")}, "the disk: full; the installed version is unchanged"),
    ],
)
def test_failed_update_is_a_one_line_error(update, options, text):
    assert update("a.bundle", **options)[:2] == (2, f"rambler update: {text}\n")
