import sys

import pytest

from hil.__main__ import main

SPEC = 'engine = "twin"\nruns = 1\nseed = 1\nseconds = 60\nscenarios = ["tank"]\n'


@pytest.mark.parametrize(
    ("missing", "words"),
    [
        ("pyarrow", ("spec.toml",)),
        ("pyarrow", ("replay", ".", "0")),
        ("pyarrow", ("compare", ".", ".")),
        ("distributed", ("spec.toml", "--scheduler", "tcp://127.0.0.1:1")),
    ],
)
def test_a_package_that_is_missing_is_told_before_anything_is_sailed(missing, words, tmp_path, monkeypatch, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, missing, None)
    assert main(["campaign", *words, "--out", "out"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"rambler-hil: {missing} is not installed; pip install 'rambler-autopilot[campaign]'\n"
    assert not (tmp_path / "out").exists()
