#!/usr/bin/env python3
"""Make a bundle that `rambler update` installs without a network: build/rambler-VERSION-COMMIT-MACHINE-PYTHON.bundle.

    bundle.py [--for MACHINE:PYTHON ...] [--drivers WHEEL ...] [--sign KEY] [--out DIR]

Example: --for aarch64:3.13 aarch64:3.11 --drivers dist/rambler_os5000-1.0-py3-none-any.whl

The bundle contains the locked packages (.ci/requirements-onboard.txt) as wheels for these computers (default: this
one), the wheel of the autopilot, the wheels of driver packages, pip, and a list with the SHA-256 of each file. With
--sign, ssh-keygen signs the list. What a driver package needs beyond the locked packages is also given as a wheel.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from firmware_py import __version__, commit_of  # noqa: E402 - of this checkout
from firmware_py.install.bundle import FORMAT, LIST, LOCK, NAMESPACE, SIGNATURE  # noqa: E402

LOCK_FILE = ROOT / ".ci/requirements-onboard.txt"
# Installs the packages on the float, and is then removed.
PIP_REQUIREMENT = "pip==25.3 --hash=sha256:9655943313a94722b7774661c21049070f6bbb0a1516bf02f7c8d5d9201514cd\n"
GLIBC_VERSIONS = (
    "2_28",
    "2_27",
    "2_26",
    "2_24",
    "2_17",
)  # the newest that a float must have, and older ones that also run on it
# Computers for which the locked packages exist as wheels.
MACHINES, PYTHONS = ("aarch64", "x86_64"), ("3.11", "3.12", "3.13", "3.14")


def main() -> int:
    """Make the bundle; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    this_computer = f"{platform.machine()}:{sys.version_info.major}.{sys.version_info.minor}"
    parser.add_argument("--for", dest="computers", metavar="MACHINE:PYTHON", nargs="*", default=[])
    parser.add_argument("--drivers", metavar="WHEEL", type=Path, nargs="*", default=[])
    parser.add_argument("--sign", metavar="KEY", type=Path)
    parser.add_argument("--out", metavar="DIR", type=Path, default=ROOT / "build")
    arguments = parser.parse_args()
    computers = sorted(set(arguments.computers or [this_computer]))
    for computer in computers:
        machine, _, python = computer.partition(":")
        if machine not in MACHINES or python not in PYTHONS:
            targets = f"MACHINE:PYTHON of {', '.join(MACHINES)} and {', '.join(PYTHONS)}, such as aarch64:3.13"
            return print_refusal(f"{computer} is not supported; use {targets}")
    for wheel in arguments.drivers:
        if not wheel.is_file() or wheel.suffix != ".whl" or wheel.name.count("-") < 4:
            return print_refusal(f"{wheel} is not a wheel; make one: pip wheel --no-deps FOLDER")
    try:
        make_bundle(computers, arguments.out, arguments.sign, arguments.drivers)
    except subprocess.CalledProcessError as error:
        return print_refusal(f"{error.cmd[0]} {' '.join(error.cmd[1:5])} ... failed; its messages are above")
    return 0


def print_refusal(reason: str) -> int:
    """Print the reason for a refusal and return the exit code."""
    print(f"bundle: {reason}", file=sys.stderr)
    return 2


def make_bundle(computers: Sequence[str], out: Path, key: Path | None, drivers: Sequence[Path] = ()) -> None:
    """Make a bundle for these computers and print its path; raise CalledProcessError if a program fails."""
    with tempfile.TemporaryDirectory() as name:
        wheels = Path(name)
        for computer in computers:
            download_packages(wheels, computer)
        requirements = wheels / "pip.txt"
        requirements.write_text(PIP_REQUIREMENT)
        run_pip("download", "--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", requirements, "-d", wheels)
        requirements.unlink()
        run_pip("wheel", "--no-deps", "--wheel-dir", wheels, ROOT)
        own_wheel = next(wheels.glob("rambler_autopilot-*.whl"))
        for wheel in drivers:
            shutil.copy(wheel, wheels)
        (wheels / LOCK).write_text("".join([LOCK_FILE.read_text(), *map(lock_line, [own_wheel, *drivers])]))
        commit = commit_of(ROOT)
        out.mkdir(exist_ok=True)
        target = out / f"rambler-{__version__}-{commit}-{'_'.join(computers).replace(':', '-')}.bundle"
        write_bundle(wheels, target, __version__, commit, commit_utc_s(), key)
    print(f"{target} ({target.stat().st_size / 1e6:.0f} MB)")


def download_packages(wheels: Path, computer: str) -> None:
    """Download the locked packages for one computer."""
    machine, _, python = computer.partition(":")
    platforms = [word for glibc in GLIBC_VERSIONS for word in ("--platform", f"manylinux_{glibc}_{machine}")]
    options = ["--platform", f"manylinux2014_{machine}", "--python-version", python, "-d", wheels]
    run_pip(
        "download", "--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", LOCK_FILE, *platforms, *options
    )


def run_pip(*words: object) -> None:
    """Run pip of this Python; raise CalledProcessError if it fails."""
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *map(str, words)]
    subprocess.run(command, check=True)  # noqa: S603 - fixed arguments


def commit_utc_s() -> int:
    """Return the time of the commit in seconds since 1970."""
    git = shutil.which("git") or "git"
    command = [git, "-C", str(ROOT), "show", "--no-patch", "--format=%ct", "HEAD"]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)  # noqa: S603 - fixed arguments


def lock_line(wheel: Path) -> str:
    """Return the line of a wheel in the list of requirements: package, version and hash."""
    package, version = wheel.name.split("-")[:2]
    return f"{package.replace('_', '-')}=={version} --hash=sha256:{sha256_of(wheel.read_bytes())}\n"


def sha256_of(content: bytes) -> str:
    """Return the SHA-256 as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def write_bundle(folder: Path, target: Path, version: str, commit: str, utc_s: int, key: Path | None = None) -> None:
    """Write the files of a folder as a reproducible bundle: the list, its signature, and the files."""
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    list_entries = {name: {"bytes": len(content), "sha256": sha256_of(content)} for name, content in files.items()}
    data = {"format": FORMAT, "version": version, "commit": commit, "commit_utc_s": utc_s, "files": list_entries}
    content = json.dumps(data, indent=1).encode() + b"\n"
    members = {LIST: content}
    if key is not None:
        command = [shutil.which("ssh-keygen") or "ssh-keygen", "-Y", "sign", "-f", str(key), "-n", NAMESPACE]
        process = subprocess.run(command, input=content, check=True, capture_output=True)  # noqa: S603 - fixed arguments
        members[SIGNATURE] = process.stdout
    with tarfile.open(target, "w:", format=tarfile.PAX_FORMAT) as archive:
        for name, member_content in (members | files).items():
            member = tarfile.TarInfo(name)
            member.size, member.mtime, member.mode = len(member_content), utc_s, 0o644
            archive.addfile(member, io.BytesIO(member_content))


if __name__ == "__main__":
    sys.exit(main())
