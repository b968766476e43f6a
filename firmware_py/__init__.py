"""Rambler's onboard autopilot: sensors -> estimate -> guidance -> control -> actuator.

This module has the version and the git commit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

__version__ = "0.1.0"

ROOT = Path(__file__).parents[1]
# Written by the build into packages (.ci/hatch_build.py): commit and its time.
COMMIT_FILE = "firmware_py/commit.txt"
GIT = ("git", "describe", "--always", "--dirty", "--exclude=*", "--abbrev=8")
GIT_TIMEOUT_S = 5.0


def version_text(program: str, commit: str) -> str:
    """Return program, version and commit, if known, for `--version` and logs."""
    return f"{program} {__version__}" + (f" (git {commit})" if commit else "")


def commit_of(root: Path) -> str:
    """Return the abbreviated commit of the tree `root`, with -dirty if it has changes; empty if unknown.

    It comes from git in a checkout, from a file in a built package. The commit of an unrelated checkout around an
    installed package is not used.
    """
    return start_commit_query(root)()


def commit_utc_s_of(root: Path) -> int | None:
    """Return the commit time of a built package, None if unknown or in a checkout."""
    time_s = _read_commit_file(root)[1]
    return int(time_s) if time_s.isdecimal() else None


def _read_commit_file(root: Path) -> tuple[str, str]:
    """Return abbreviated commit and commit time from the build, empty if missing."""
    try:
        commit, time_s, *_ = *(root / COMMIT_FILE).read_text(encoding="ascii").splitlines(), "", ""
    except (OSError, ValueError):
        return "", ""
    return commit.strip(), time_s.strip()


def start_commit_query(root: Path) -> Callable[[], str]:
    """Start git to read the commit of the tree `root`; return a function that waits for the result."""
    if not (root / ".git").exists():
        commit = _read_commit_file(root)[0]
        return lambda: commit
    import subprocess  # noqa: PLC0415 - only for --version and logs

    try:
        git = subprocess.Popen(  # noqa: S603 - fixed arguments
            GIT, cwd=root, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    except OSError:
        return lambda: ""

    def wait_for_commit() -> str:
        with git:
            try:
                text = git.communicate(timeout=GIT_TIMEOUT_S)[0]
            except (subprocess.TimeoutExpired, ValueError):
                git.kill()
                return ""
        return text.strip() if git.returncode == 0 else ""

    return cache(wait_for_commit)
