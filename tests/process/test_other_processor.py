"""Logs made here are recomputed by the processor of a float to the same rudder, within 1e-9 rad.

The bound holds up to the first decision that differs (support/decisions.py): the C libraries of the two may differ in
the last bit, and a number close to a threshold then falls on the other side of it.

`.ci/debian_tree DIR trixie arm64` makes a tree of 64-bit ARM, whose programs run here by QEMU's user emulation. C
library, Python and numpy are those of that processor. Without a tree the test reports why and is skipped; with a tree
that ARM_TREE names it fails instead.
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
WHO = "import platform, sys; print(platform.machine(), '%d.%d' % sys.version_info[:2])"
SCENES = ("swell", "ocean-2")
LEAST_TICKS = 600  # a minute of a run agrees in all decisions: fewer would show nothing
PATIENCE_S = 1500.0


def output_of(*words):
    return subprocess.run(list(map(str, words)), check=False, capture_output=True, text=True, timeout=PATIENCE_S)


def in_tree(*arguments, **environment):
    settings = [f"{name}={value}" for name, value in environment.items()]
    return output_of("chroot", TREE, "/usr/bin/env", *settings, "/usr/bin/python3", *arguments)


def why_not():
    if os.geteuid() != 0:
        return "to enter another tree takes root"
    if not (TREE / "usr/bin/python3").exists():
        return f"there is no tree of {MACHINE} at {TREE}; .ci/debian_tree makes it (trixie arm64)"
    found = in_tree("-c", WHO)
    return "" if found.stdout.startswith(MACHINE) else f"the tree's programs do not run: {found.stderr[-200:]}"


WHY_NOT = why_not()
SKIPPED = bool(WHY_NOT) and "ARM_TREE" not in os.environ
pytestmark = [pytest.mark.proof, pytest.mark.timeout(3600), pytest.mark.skipif(SKIPPED, reason=WHY_NOT or "-")]


@pytest.fixture
def shared():
    """A folder of the tree with the program, the wheels of its lock for that machine, and room for logs."""
    assert WHY_NOT == ""
    python = in_tree("-c", WHO).stdout.split()[1]
    with tempfile.TemporaryDirectory(dir=TREE / "srv") as name:
        folder = Path(name)
        folder.chmod(0o755)
        shutil.copytree(ROOT / "firmware_py", folder / "site/firmware_py", ignore=shutil.ignore_patterns("__pycache__"))
        platforms = [f"--platform={glibc}_{MACHINE}" for glibc in ("manylinux_2_28", "manylinux_2_27", "manylinux2014")]
        wanted = ["--require-hashes", "--no-deps", "-r", str(ROOT / ".ci/requirements-onboard.txt")]
        there = ["--only-binary=:all:", "--python-version", python, *platforms, "--target", str(folder / "site")]
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", *there, *wanted]
        subprocess.run(pip, check=True)
        yield folder


@pytest.fixture(scope="module")
def sailed(tmp_path_factory):
    """Logs of two minutes in each of the seas, of the program as it is."""
    out = tmp_path_factory.mktemp("sailed")
    arguments = ["--speed", "max", "--seconds", "120", "--seed", "3", "--goal", "0:0,20:90"]
    for scene in SCENES:
        words = [sys.executable, "-m", "hil", "run", scene, *arguments, "--out", str(out / scene)]
        subprocess.run(words, check=True, capture_output=True)
    return {scene: out / scene / "state/logs/00000001.BIN" for scene in SCENES}


def test_logs_are_recomputed_to_the_same_rudder_by_another_processor(sailed, shared):
    logs = {"/".join(path.relative_to(REPLAY).parts): path for path in sorted(REPLAY.rglob("*.BIN"))} | sailed
    place = Path("/") / shared.relative_to(TREE)
    shutil.copy(decisions.__file__, shared / "decisions.py")
    for name, path in logs.items():
        shutil.copy(path, shared / "log.BIN")
        there = in_tree(place / "decisions.py", place / "log.BIN", PYTHONPATH=place / "site")
        assert there.returncode == 0, there.stderr
        found = decisions.agreement(list(decisions.recomputed(path)), decisions.read(there.stdout))
        print(f"{MACHINE}: {name}: {found}")
        assert found.largest_rad <= decisions.BOUND_RAD
        assert found.ticks >= (LEAST_TICKS if name in sailed else 1)
