import os
import signal

import pytest

from hil.__main__ import main
from hil.cli import drill


@pytest.mark.parametrize("option", ["--json", "--page"])
def test_a_file_that_cannot_be_written_is_told_before_anything_is_sailed(option, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(drill, "sail", None)
    assert main(["drill", "--only", "killed", "--jobs", "1", option, str(tmp_path / "none" / "file")]) == 2
    assert f"{option} {tmp_path}/none/file: there is no directory" in capsys.readouterr().err


def test_told_to_end_a_drill_of_one_job_unwinds_as_those_of_many(monkeypatch, capsys):
    monkeypatch.setattr(drill, "sail", lambda _case: os.kill(os.getpid(), signal.SIGTERM))
    assert main(["drill", "--only", "killed", "--jobs", "1"]) == 130
    assert capsys.readouterr().err == "rambler-hil: interrupted\n"
