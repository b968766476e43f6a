"""Target computers and dependencies of `make bundle`."""

import re
import subprocess

import pytest

from support.paths import ROOT
from support.small_bundle import bundle_maker


@pytest.mark.parametrize("computer", ["armv7l:3.13", "aarch64:3.10", "aarch64", ""])
def test_unsupported_computer_names_the_supported_ones(computer, monkeypatch, capsys):
    maker = bundle_maker()
    monkeypatch.setattr(maker, "pip", lambda *_: pytest.fail("asks for packages"))
    monkeypatch.setattr("sys.argv", ["bundle.py", "--for", "aarch64:3.13", computer])
    assert maker.main() == 2
    assert capsys.readouterr().err == (
        f"bundle: {computer} is not supported; use MACHINE:PYTHON of aarch64, x86_64 and 3.11, 3.12, 3.13, 3.14,"
        " such as aarch64:3.13\n"
    )


def test_bundle_name_has_its_computers(monkeypatch, tmp_path, capsys):
    maker = bundle_maker()

    def pip(*words):
        if words[0] == "wheel":
            (words[3] / "rambler_autopilot-0-py3-none-any.whl").touch()

    monkeypatch.setattr(maker, "pip", pip)
    words = ["--for", "x86_64:3.11", "aarch64:3.13", "--out", str(tmp_path)]
    monkeypatch.setattr("sys.argv", ["bundle.py", *words])
    assert maker.main() == 0
    assert "-aarch64-3.13_x86_64-3.11.bundle (" in capsys.readouterr().out


def test_failing_program_is_a_one_line_error(monkeypatch, tmp_path, capsys):
    maker = bundle_maker()

    def pip(*words):
        raise subprocess.CalledProcessError(1, ["python", "-m", "pip", *map(str, words)])

    monkeypatch.setattr(maker, "pip", pip)
    monkeypatch.setattr("sys.argv", ["bundle.py", "--for", "x86_64:3.11", "--out", str(tmp_path)])
    assert maker.main() == 2
    assert capsys.readouterr().err == "bundle: python -m pip download --no-deps ... failed; its messages are above\n"


def test_make_bundle_installs_no_tests_or_simulator():
    output = subprocess.run(
        ["make", "-n", "-B", "bundle", "PIP=pip-install"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert re.findall("pip-install .*", output) == ["pip-install msgspec"]
