"""Rambler's onboard autopilot: sensors -> estimate -> guidance -> control -> actuator; its version and git commit."""

from __future__ import annotations

from pathlib import Path

__version__ = "0.1.0.dev0"

ROOT = Path(__file__).parents[1]
# Only a built package holds this file; the build writes it (.ci/hatch_build.py).
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
    if not (root / ".git").exists():
        try:
            return (root / COMMIT_FILE).read_text(encoding="ascii").strip()
        except (OSError, ValueError):
            return ""
    import subprocess  # noqa: PLC0415 - only --version and a log's opening ask

    try:
        answer = subprocess.run(  # noqa: S603 - words of our own
            GIT, cwd=root, capture_output=True, text=True, timeout=GIT_PATIENCE_S, check=True
        )
    except (OSError, ValueError, subprocess.SubprocessError):
        return ""
    return answer.stdout.strip()
