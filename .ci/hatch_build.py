"""Add the git commit to wheels and source archives, for `--version` without a repository."""

import importlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CommitHook(BuildHookInterface[Any]):
    """Adds the commit file that firmware_py/__init__.py reads; a source archive already contains it."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the commit and its time to a file and add it; an editable install reads git at run time."""
        root = Path(self.root)
        if version == "editable" or not (root / ".git").exists():
            return
        sys.path.insert(0, self.root)
        module = importlib.import_module("firmware_py")
        self.folder = tempfile.TemporaryDirectory()  # exists until the build has copied the file
        commit_file = Path(self.folder.name) / "commit.txt"
        command = [shutil.which("git") or "git", "show", "--no-patch", "--format=%ct", "HEAD"]
        commit_time = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout  # noqa: S603 - fixed arguments
        commit_file.write_text(f"{module.commit_of(root)}\n{commit_time}", encoding="ascii")
        build_data["force_include"][str(commit_file)] = module.COMMIT_FILE
