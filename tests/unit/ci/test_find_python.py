"""The Python interpreter that `make` selects."""

import os
import subprocess

import pytest

from support.paths import ROOT

FIND = ROOT / ".ci" / "find_python"
USABLE, OLD, WITHOUT_VENV = (True, True), (False, True), (True, False)


@pytest.fixture
def find(tmp_path):
    """Run the script with these Pythons only: name -> (version is new enough, has venv)."""

    def run(*arguments, **pythons):
        for name, (is_new_enough, has_venv) in pythons.items():
            path = tmp_path / name.replace("_", ".")
            tests = f"*ensurepip*) exit {1 - has_venv};; *) exit {1 - is_new_enough};;"
            path.write_text(f'#!/bin/sh\ncase "$2" in {tests} esac\n')
            path.chmod(0o755)
        command, env = ["/bin/sh", FIND, *arguments], {"PATH": str(tmp_path)}
        return subprocess.run(command, env=env, capture_output=True, text=True, check=False)

    return run


@pytest.mark.parametrize(
    ("arguments", "pythons", "name"),
    [
        ((), {"python3_14": (False, False), "python3_12": USABLE, "python3_11": USABLE}, "python3.12"),
        ((), {"python3": USABLE}, "python3"),
        ((), {"python3_13": WITHOUT_VENV, "python3_11": USABLE}, "python3.11"),
        (("",), {"python3": USABLE}, "python3"),
    ],
    ids=["newest that works", "python3", "without venv", "empty name"],
)
def test_newest_usable_python_is_selected(find, arguments, pythons, name):
    assert find(*arguments, **pythons).stdout == f"{name}\n"


def test_named_python_is_used_without_search(find, tmp_path):
    path = f"{tmp_path}/python3.12"
    assert find(path, python3_12=USABLE, python3_14=USABLE).stdout == f"{path}\n"


@pytest.mark.parametrize(
    ("arguments", "pythons", "text"),
    [
        (("python3.9",), {"python3_9": OLD}, "python3.9 is no Python from 3.11 to 3.14"),
        ((), {"python3": OLD}, "make PYTHON="),
        ((), {"python3_12": WITHOUT_VENV}, "apt install python3.12-venv"),
    ],
    ids=["named", "none", "without venv"],
)
def test_no_usable_python_is_a_one_line_error_with_remedy(find, arguments, pythons, text):
    process = find(*arguments, **pythons)
    assert (process.returncode, process.stdout, process.stderr.count("\n")) == (2, "", 1)
    assert text in process.stderr


def test_python_of_this_computer_is_found():
    name = subprocess.run([FIND], env=dict(os.environ), capture_output=True, text=True, check=True).stdout.strip()
    subprocess.run([name, "-c", "import sys; assert sys.version_info >= (3, 11)"], check=True)
