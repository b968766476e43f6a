"""`rambler report`: arguments, errors and exit code of `rambler-hil report`."""

import sys
from types import SimpleNamespace

import pytest

from firmware_py.__main__ import main
from firmware_py.cli import report as command


@pytest.mark.parametrize("code", [0, 2])
@pytest.mark.parametrize(("words", "options"), [((), []), (("--out", "a.html"), ["--out", "a.html"])])
def test_page_is_written_by_the_harness(monkeypatch, capsys, code, words, options):
    commands = []

    def run(arguments, **_options):
        commands.append(arguments)
        return SimpleNamespace(returncode=code, stderr="rambler-hil: no log\nother\n")

    monkeypatch.setattr(command.subprocess, "run", run)
    assert main(["report", *words, "a.BIN", "b.BIN"]) == code
    assert commands == [[sys.executable, "-m", "hil", "report", *options, "--", "a.BIN", "b.BIN"]]
    assert capsys.readouterr().err == "rambler report: no log\nother\n"
