"""Small bundles, written with the program that writes the real ones."""

import importlib.util

from support.killed_update import PROGRAM
from support.paths import ROOT


def load_bundle_maker():
    """Return the module that `make bundle` runs."""
    spec = importlib.util.spec_from_file_location("bundle_maker", ROOT / ".ci/bundle.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def small_bundle(folder, code=0, version="9.9.9", wheels=()):
    """Write a bundle whose autopilot is a shell script with this exit code, with more wheels; return its path."""
    (files := folder / f"files-{version}").mkdir()
    (files / f"rambler_autopilot-{version}-py3-none-any.whl").write_text(PROGRAM.format(version="new", code=code))
    (files / "pip-1.0-py3-none-any.whl").touch()
    (files / "requirements.txt").touch()
    for name in wheels:
        (files / name).touch()
    path = folder / f"{version}.bundle"
    load_bundle_maker().write_bundle(files, path, version, "abcd1234", 1000)
    return path
