"""Puts the git commit into what is built, for `--version` where there is no repository."""

import importlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface[Any]):
    """Adds the file that firmware_py/__init__.py reads; a source archive hands on the one it has."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the commit and its time beside the build and add it; an editable install asks git itself."""
        root = Path(self.root)
        if version == "editable" or not (root / ".git").exists():
            return
        sys.path.insert(0, self.root)
        module = importlib.import_module("firmware_py")
        self.folder = tempfile.TemporaryDirectory()  # lives until the build has taken the file
        file = Path(self.folder.name) / "commit.txt"
        command = [shutil.which("git") or "git", "show", "--no-patch", "--format=%ct", "HEAD"]
        second = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout  # noqa: S603 - words of our own
        file.write_text(f"{module.commit_of(root)}\n{second}", encoding="ascii")
        build_data["force_include"][str(file)] = module.COMMIT_FILE
