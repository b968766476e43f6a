import os
import signal

import pytest

from hil.__main__ import main
from hil.cli import drill


@pytest.mark.parametrize("option", ["--json", "--page"])
def test_file_that_cannot_be_written_is_reported_before_the_first_drill(option, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(drill, "sail", None)
    assert main(["drill", "--only", "killed", "--jobs", "1", option, str(tmp_path / "missing" / "file")]) == 2
    assert f"{option} {tmp_path}/missing/file: directory" in capsys.readouterr().err


def test_sigterm_ends_drills_in_this_process(monkeypatch, capsys):
    monkeypatch.setattr(drill, "sail", lambda _case: os.kill(os.getpid(), signal.SIGTERM))
    assert main(["drill", "--only", "killed", "--jobs", "1"]) == 130
    assert capsys.readouterr().err == "rambler-hil: interrupted\n"
