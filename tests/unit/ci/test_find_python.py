"""The Python interpreter that `make` selects."""

import os
import subprocess

import pytest

from support.paths import ROOT

FIND = ROOT / ".ci" / "find_python"


@pytest.fixture
def find(tmp_path):
    """Run the script with these Pythons only: name -> (version is new enough, has venv)."""

    def run(*arguments, **pythons):
        for name, (version, venv) in pythons.items():
            path = tmp_path / name.replace("_", ".")
            path.write_text(f'#!/bin/sh\ncase "$2" in *ensurepip*) exit {1 - venv};; *) exit {1 - version};; esac\n')
            path.chmod(0o755)
        return subprocess.run(
            ["/bin/sh", FIND, *arguments], env={"PATH": str(tmp_path)}, capture_output=True, text=True, check=False
        )

    return run


def test_newest_working_python_is_used(find):
    assert find(python3_14=(False, False), python3_12=(True, True), python3_11=(True, True)).stdout == "python3.12\n"


def test_python3_is_used_if_new_enough(find):
    assert find(python3=(True, True)).stdout == "python3\n"


def test_python_without_venv_is_skipped(find):
    assert find(python3_13=(True, False), python3_11=(True, True)).stdout == "python3.11\n"


def test_given_python_is_used_without_search(find, tmp_path):
    path = f"{tmp_path}/python3.12"
    assert find(path, python3_12=(True, True), python3_14=(True, True)).stdout == f"{path}\n"
    refused = find("python3.9", python3_9=(False, True))
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "python3.9 is no Python from 3.11 to 3.14" in refused.stderr


def test_no_python_is_an_error_with_remedy(find):
    refused = find(python3=(False, True))
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
    assert "make PYTHON=" in refused.stderr


def test_missing_venv_names_the_package(find):
    refused = find(python3_12=(True, False))
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
    assert "apt install python3.12-venv" in refused.stderr


def test_empty_name_counts_as_none(find):
    assert find("", python3=(True, True)).stdout == "python3\n"


def test_real_python_is_found():
    found = subprocess.run([FIND], env=dict(os.environ), capture_output=True, text=True, check=True).stdout.strip()
    subprocess.run([found, "-c", "import sys; assert sys.version_info >= (3, 11)"], check=True)
