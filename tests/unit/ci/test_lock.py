"""The package lock of the onboard computer is complete, with hashes and with the tested versions."""

import importlib.metadata
import importlib.util
import json
import re
import subprocess
import sys
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support.paths import ROOT

LOCK = ROOT / ".ci/requirements-onboard.txt"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCKED_PACKAGE = re.compile(r"([A-Za-z0-9._-]+)==([^\s;]+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n")


def locked_packages():
    """Return version and hashes of each package by its name."""
    return {canonicalize_name(name): (version, re.findall(r"[0-9a-f]{64}", hashes))
            for name, version, hashes in LOCKED_PACKAGE.findall(LOCK.read_text())}  # fmt: skip


def test_lock_has_versions_and_hashes_only():
    """A package index or an environment marker in the lock would apply on every boat."""
    assert LOCKED_PACKAGE.sub("", LOCK.read_text()) == ""
    for name, (_, hashes) in locked_packages().items():
        assert len(hashes) == len(set(hashes)) >= 2, f"{name}: at least a wheel and a source archive"


def test_locked_versions_are_the_tested_ones():
    lines = (ROOT / ".ci/constraints.txt").read_text().split()
    constraints = {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}
    assert {name: constraints[name] for name in locked_packages()} == {
        name: version for name, (version, _) in locked_packages().items()
    }


def test_lock_is_complete():
    pending, names = [Requirement(text) for text in PROJECT["dependencies"]], set()
    while pending:
        requirement = pending.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        name = canonicalize_name(requirement.name)
        assert name in locked_packages(), f"{name} is not locked: run `make lock`"
        assert requirement.specifier.contains(locked_packages()[name][0]), f"{requirement}: run `make lock`"
        if name not in names:
            names.add(name)
            pending += [Requirement(text) for text in importlib.metadata.requires(name) or ()]
    assert names == set(locked_packages()), "no unused package"


def test_changed_package_is_refused(tmp_path):
    """Check with pip: a wheel with name and version of pyserial but other bytes."""
    wheel = tmp_path / "pyserial-3.5-py3-none-any.whl"
    wheel.write_bytes(b"PK\5\6" + bytes(18))  # an empty archive
    lines = re.search(r"pyserial==3\.5 .*?\n(?=\S|\Z)", LOCK.read_text(), re.DOTALL)[0]
    (tmp_path / "lock.txt").write_text(lines)
    words = ["install", "--isolated", "--no-index", "--no-deps", "--dry-run", "--ignore-installed"]
    command = [sys.executable, "-m", "pip", *words, f"--find-links={tmp_path}", "-r", str(tmp_path / "lock.txt")]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    assert process.returncode == 1
    assert "THESE PACKAGES DO NOT MATCH THE HASHES" in process.stderr


def test_sbom_is_valid_and_names_the_locked_packages(tmp_path):
    if importlib.util.find_spec("cyclonedx_py") is None:
        pytest.skip("cyclonedx-bom is not installed; install the extra [supply]")
    out = tmp_path / "sbom.json"
    options = ["--pyproject", str(ROOT / "pyproject.toml"), "--mc-type", "firmware", "--validate", "-o", str(out)]
    subprocess.run([sys.executable, "-m", "cyclonedx_py", "environment", sys.executable, *options], check=True)
    sbom = json.loads(out.read_text())
    assert sbom["metadata"]["component"]["name"] == PROJECT["name"]
    versions = {canonicalize_name(component["name"]): component["version"] for component in sbom["components"]}
    assert versions.items() >= {name: version for name, (version, _) in locked_packages().items()}.items()
