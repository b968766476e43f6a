"""Bundles of a few bytes, made by what makes the real ones."""

import importlib.util

from support.killed_update import PROGRAM
from support.paths import ROOT


def bundle_maker():
    """What `make bundle` runs."""
    spec = importlib.util.spec_from_file_location("bundle_maker", ROOT / ".ci/bundle.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def small_bundle(folder, code=0, version="9.9.9"):
    """A bundle whose autopilot is a shell script, which ends with a code."""
    (files := folder / f"files-{version}").mkdir()
    (files / f"rambler_autopilot-{version}-py3-none-any.whl").write_text(PROGRAM.format(version="new", code=code))
    (files / "pip-1.0-py3-none-any.whl").touch()
    (files / "requirements.txt").touch()
    path = folder / f"{version}.bundle"
    bundle_maker().write_bundle(files, path, version, "abcd1234", 1000)
    return path
