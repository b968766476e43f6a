"""A 64-bit ARM processor recomputes logs of this computer to the same rudder within 1e-9 rad.

The bound applies up to the first decision that differs (support/decisions.py): the C libraries may differ in the last
bit, so that a number close to a threshold may exceed it on one processor only.

`.ci/debian_tree DIR trixie arm64` makes a tree of 64-bit ARM, whose programs run by the user emulation of QEMU. Without
a tree the test is skipped with the reason; if ARM_TREE names a tree, the test fails instead.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from support import decisions
from support.paths import REPLAY, ROOT

TREE = Path(os.environ.get("ARM_TREE", ROOT / "build/debian-trixie-arm64"))
MACHINE = "aarch64"
PLATFORM_CODE = "import platform, sys; print(platform.machine(), '%d.%d' % sys.version_info[:2])"
SCENARIOS = ("swell", "ocean-2")
MIN_TICKS = 600  # one minute, in which all decisions must agree
TIMEOUT_S = 1500.0


def run_command(*words):
    return subprocess.run(list(map(str, words)), check=False, capture_output=True, text=True, timeout=TIMEOUT_S)


def run_in_tree(*arguments, **environment):
    settings = [f"{name}={value}" for name, value in environment.items()]
    return run_command("chroot", TREE, "/usr/bin/env", *settings, "/usr/bin/python3", *arguments)


def missing_requirement():
    if os.geteuid() != 0:
        return "chroot needs root"
    if not (TREE / "usr/bin/python3").exists():
        return f"there is no tree of {MACHINE} at {TREE}; .ci/debian_tree makes it (trixie arm64)"
    process = run_in_tree("-c", PLATFORM_CODE)
    return "" if process.stdout.startswith(MACHINE) else f"programs of the tree do not run: {process.stderr[-200:]}"


REASON = missing_requirement()
IS_SKIPPED = bool(REASON) and "ARM_TREE" not in os.environ
pytestmark = [pytest.mark.proof, pytest.mark.timeout(3600), pytest.mark.skipif(IS_SKIPPED, reason=REASON or "-")]


@pytest.fixture
def tree_folder():
    """A folder in the tree with the program and the locked packages for that processor."""
    assert REASON == ""
    python = run_in_tree("-c", PLATFORM_CODE).stdout.split()[1]
    with tempfile.TemporaryDirectory(dir=TREE / "srv") as name:
        folder = Path(name)
        folder.chmod(0o755)
        shutil.copytree(ROOT / "firmware_py", folder / "site/firmware_py", ignore=shutil.ignore_patterns("__pycache__"))
        platforms = [f"--platform={glibc}_{MACHINE}" for glibc in ("manylinux_2_28", "manylinux_2_27", "manylinux2014")]
        packages = ["--require-hashes", "--no-deps", "-r", str(ROOT / ".ci/requirements-onboard.txt")]
        target = ["--only-binary=:all:", "--python-version", python, *platforms, "--target", str(folder / "site")]
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", *target, *packages]
        subprocess.run(pip, check=True)
        yield folder


@pytest.fixture(scope="module")
def logs_of_runs(tmp_path_factory):
    """Logs of two minutes in each scenario."""
    out = tmp_path_factory.mktemp("sailed")
    arguments = ["--speed", "max", "--seconds", "120", "--seed", "3", "--goal", "0:0,20:90"]
    for scenario in SCENARIOS:
        words = [sys.executable, "-m", "hil", "run", scenario, *arguments, "--out", str(out / scenario)]
        subprocess.run(words, check=True, capture_output=True)
    return {scenario: out / scenario / "state/logs/00000001.BIN" for scenario in SCENARIOS}


def test_another_processor_recomputes_logs_to_the_same_rudder(logs_of_runs, tree_folder):
    logs = {"/".join(path.relative_to(REPLAY).parts): path for path in sorted(REPLAY.rglob("*.BIN"))} | logs_of_runs
    folder_in_tree = Path("/") / tree_folder.relative_to(TREE)
    shutil.copy(decisions.__file__, tree_folder / "decisions.py")
    for name, path in logs.items():
        shutil.copy(path, tree_folder / "log.BIN")
        process = run_in_tree(
            folder_in_tree / "decisions.py", folder_in_tree / "log.BIN", PYTHONPATH=folder_in_tree / "site"
        )
        assert process.returncode == 0, process.stderr
        agreement = decisions.compare(list(decisions.recompute(path)), decisions.read(process.stdout))
        print(f"{MACHINE}: {name}: {agreement}")
        assert agreement.max_difference_rad <= decisions.MAX_DIFFERENCE_RAD
        assert agreement.ticks >= (MIN_TICKS if name in logs_of_runs else 1)
