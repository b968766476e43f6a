"""Rambler's onboard autopilot: sensors -> estimate -> guidance -> control -> actuator; its version and git commit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

__version__ = "0.1.0"

ROOT = Path(__file__).parents[1]
# Only a built package holds this file: its commit, and when that was made; the build writes it (.ci/hatch_build.py).
COMMIT_FILE = "firmware_py/commit.txt"
GIT = ("git", "describe", "--always", "--dirty", "--exclude=*", "--abbrev=8")
GIT_PATIENCE_S = 5.0


def version_text(program: str, commit: str) -> str:
    """Return what `--version` prints and a log's opening says: program, version and, where it is known, the commit."""
    return f"{program} {__version__}" + (f" (git {commit})" if commit else "")


def commit_of(root: Path) -> str:
    """Return the abbreviated commit of the tree `root`, ending in -dirty for one with changes; empty when unknown.

    A checkout asks git; a built package has it in a file. A package that is installed somewhere inside a checkout
    of something else does not take that one's commit for its own.
    """
    return ask_commit(root)()


def commit_utc_s_of(root: Path) -> int | None:
    """Return when the commit of a built package was made; None when that is not known, and of a checkout."""
    second = _built_of(root)[1]
    return int(second) if second.isdecimal() else None


def _built_of(root: Path) -> tuple[str, str]:
    """Return what the build has written of the commit: its abbreviation and its second; empty what is not there."""
    try:
        commit, second, *_ = *(root / COMMIT_FILE).read_text(encoding="ascii").splitlines(), "", ""
    except (OSError, ValueError):
        return "", ""
    return commit.strip(), second.strip()


def ask_commit(root: Path) -> Callable[[], str]:
    """Begin to find out the commit of the tree `root`; the answer is waited for when it is called for."""
    if not (root / ".git").exists():
        known = _built_of(root)[0]
        return lambda: known
    import subprocess  # noqa: PLC0415 - only --version and a log's opening ask

    try:
        git = subprocess.Popen(  # noqa: S603 - words of our own
            GIT, cwd=root, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
    except OSError:
        return lambda: ""

    def answer() -> str:
        with git:
            try:
                text = git.communicate(timeout=GIT_PATIENCE_S)[0]
            except (subprocess.TimeoutExpired, ValueError):
                git.kill()
                return ""
        return text.strip() if git.returncode == 0 else ""

    return cache(answer)
