"""Target computers and dependencies of `make bundle`."""

import hashlib
import re
import subprocess

import pytest

from firmware_py.install.bundle import unpack
from support.paths import ROOT
from support.small_bundle import load_bundle_maker


@pytest.fixture
def make_bundle(monkeypatch):
    """Run .ci/bundle.py with a replacement of pip; return the exit code."""

    def run(run_pip, *arguments):
        maker = load_bundle_maker()
        monkeypatch.setattr(maker, "run_pip", run_pip)
        monkeypatch.setattr("sys.argv", ["bundle.py", *arguments])
        return maker.main()

    return run


@pytest.mark.parametrize("computer", ["armv7l:3.13", "aarch64:3.10", "aarch64", ""])
def test_unsupported_computer_is_refused_with_the_supported_ones(computer, make_bundle, capsys):
    assert make_bundle(lambda *_: pytest.fail("pip runs"), "--for", "aarch64:3.13", computer) == 2
    assert capsys.readouterr().err == (
        f"bundle: {computer} is not supported; use MACHINE:PYTHON of aarch64, x86_64 and 3.11, 3.12, 3.13, 3.14,"
        " such as aarch64:3.13\n"
    )


def test_bundle_name_has_its_computers(make_bundle, tmp_path, capsys):
    def run_pip(*words):
        if words[0] == "wheel":
            (words[3] / "rambler_autopilot-0-py3-none-any.whl").touch()

    assert make_bundle(run_pip, "--for", "x86_64:3.11", "aarch64:3.13", "--out", str(tmp_path)) == 0
    assert "-aarch64-3.13_x86_64-3.11.bundle (" in capsys.readouterr().out


def test_driver_packages_are_in_the_list_of_requirements(make_bundle, tmp_path):
    def run_pip(*words):
        if words[0] == "wheel":
            (words[3] / "rambler_autopilot-0-py3-none-any.whl").touch()

    wheel = tmp_path / "rambler_os5000-1.0-py3-none-any.whl"
    wheel.write_bytes(b"wheel")
    assert make_bundle(run_pip, "--out", str(tmp_path), "--drivers", str(wheel)) == 0
    unpack(next(tmp_path.glob("*.bundle")), tmp_path / "unpacked", None)
    lines = (tmp_path / "unpacked/requirements.txt").read_text().splitlines()
    assert lines[-1] == f"rambler-os5000==1.0 --hash=sha256:{hashlib.sha256(b'wheel').hexdigest()}"
    assert (tmp_path / "unpacked" / wheel.name).read_bytes() == b"wheel"


@pytest.mark.parametrize("name", ["missing-1.0-py3-none-any.whl", "package-1.0.tar.gz", "package.whl"])
def test_driver_package_that_is_no_wheel_is_refused(make_bundle, tmp_path, capsys, name):
    if "missing" not in name:
        (tmp_path / name).touch()
    assert make_bundle(lambda *_: pytest.fail("pip runs"), "--drivers", str(tmp_path / name)) == 2
    assert capsys.readouterr().err == (
        f"bundle: {tmp_path / name} is not a wheel; make one: pip wheel --no-deps FOLDER\n"
    )


def test_failing_program_is_a_one_line_error(make_bundle, tmp_path, capsys):
    def run_pip(*words):
        raise subprocess.CalledProcessError(1, ["python", "-m", "pip", *map(str, words)])

    assert make_bundle(run_pip, "--for", "x86_64:3.11", "--out", str(tmp_path)) == 2
    assert capsys.readouterr().err == "bundle: python -m pip download --no-deps ... failed; its messages are above\n"


def test_make_bundle_installs_no_tests_or_simulator():
    command = ["make", "-n", "-B", "bundle", "PIP=pip-install"]
    output = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert re.findall("pip-install .*", output) == ["pip-install msgspec"]
