"""An update that is ended anywhere leaves a boat that steers, and the next one goes through."""

import contextlib
import fcntl
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

from firmware_py.install.bundle import unpack
from firmware_py.install.environment import Environment, make
from support.paths import ROOT
from support.small_bundle import bundle_maker, small_bundle

KILLS = int(os.environ.get("UPDATE_KILLS", "10"))
UPDATE_S = 40.0  # about what one takes before its trial, on two busy cores
MEMORY = Path("/dev/shm")  # the disk's own time is of no interest here


def ended_everywhere(tmp_path, kind, code=0, every=1):
    program, bundle = Path(ROOT) / "tests/support/killed_update.py", small_bundle(tmp_path, code)
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
        command = [sys.executable, str(program), folder, str(bundle), kind, str(every)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    steps = [json.loads(line) for line in done.stdout.splitlines()]
    assert steps[-1]["how"] == "done"
    return steps


@pytest.mark.parametrize(
    ("kind", "how", "every"),
    [("kill", "killed", 6), ("full", "refused", 1), pytest.param("kill", "killed", 1, marks=pytest.mark.proof)],
)
def test_an_update_that_ends_anywhere_leaves_a_boat_that_steers_and_updates(tmp_path, kind, how, every):
    steps = ended_everywhere(tmp_path, kind, every=every)
    assert len(steps) > {"kill": 100, "full": 15}[kind] / every, "the steps are found"
    for one in steps[:-1]:
        assert one["how"] == how, one
        # Whatever is in force, the first start steers; a failed trial ends with the version before.
        assert set(one["starts"]) <= {"steers old", "steers new"}, one
        assert one["starts"][-1] == "steers old", one
        assert one["closed"] == [], one
        assert (one["again"], one["starts again"]) == ("done", ["steers new"] * 2), one
        assert len(one["left"]) == 2, one
    assert steps[-1]["starts"] == ["steers new"] * 3 + ["steers old"]


@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.proof)])
def test_a_version_that_does_not_start_is_rolled_back(tmp_path, every):
    steps = ended_everywhere(tmp_path, "kill", code=1, every=every)
    for one in steps:
        assert one["starts"] in (["steers old"] * 4, [""] * 3 + ["steers old"]), one
    assert steps[-1]["starts"][0] == ""


def version_of_checkout():
    return re.search(r'__version__ = "(.*)"', (ROOT / "firmware_py/__init__.py").read_text())[1]


def other_version(folder, whole, version, change):
    """A bundle of this checkout as another version, with a change of its files and the packages of a whole one."""
    tree = folder / f"tree-{version}"
    left_out = shutil.ignore_patterns(".git", ".venv", "build", "tests", "docs", "__pycache__", ".mypy_cache")
    shutil.copytree(ROOT, tree, ignore=left_out)
    file = tree / "firmware_py/__init__.py"
    file.write_text(file.read_text().replace(version_of_checkout(), version))
    change(tree)
    unpack(whole, wheels := folder / f"wheels-{version}", None)
    next(wheels.glob("rambler_autopilot-*.whl")).unlink()
    maker = bundle_maker()
    maker.pip("wheel", "--no-deps", "--wheel-dir", wheels, tree)
    own = next(wheels.glob("rambler_autopilot-*.whl"))
    text = f"{maker.LOCK_FILE.read_text()}{maker.OWN}=={version} --hash=sha256:{maker.digest(own.read_bytes())}\n"
    (wheels / "requirements.txt").write_text(text)
    (wheels / "bundle.json").unlink()
    maker.pack(wheels, target := folder / f"{version}.bundle", version, "", int(time.time()))
    return target


def same(_tree):
    """Change nothing."""


def dies_as_a_service(tree):
    """It passes whatever is tried beside the service, and ends in it at once."""
    file = tree / "firmware_py/cli/run.py"
    text = file.read_text()
    file.write_text(
        text.replace(
            "def run(arguments", 'if "RUNTIME_DIRECTORY" in os.environ:\n    sys.exit(3)\n\n\ndef run(arguments'
        )
    )
    file.write_text(file.read_text().replace("import os\n", "import os\nimport sys\n", 1))


def cannot_be_imported(tree):
    (tree / "firmware_py/core/step.py").write_text("raise ImportError('no step')\n")


class UpdatedBoat:
    """A boat on its mission, whose service runs the program behind a symbolic link, and its updates."""

    def __init__(self, service, place):
        self.service, self.link = service, place / "bin/rambler"
        self.places = place

    def command(self, *words):
        return [str(self.link), "update", *map(str, words), "--unit", str(self.service.unit)]

    def update(self, *words):
        """Run `rambler update`; return its exit code and all that it says."""
        done = subprocess.run(self.command(*words), capture_output=True, text=True, env=CLEAN, check=False)
        print(done.stdout + done.stderr)
        return done.returncode, done.stdout + done.stderr

    def await_programs(self):
        """Until pip of an update that was killed has ended, which holds on to its lock."""
        descriptor = os.open(self.link.parent, os.O_RDONLY)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        os.close(descriptor)

    def version(self):
        done = subprocess.run([str(self.link), "--version"], capture_output=True, text=True, check=True, env=CLEAN)
        return done.stdout.split()[1]

    def steers(self):
        """The boat is under way as before, in this run and in the next one."""
        self.service.goals.first_after(time.monotonic())
        self.service.assert_as_before()
        self.service.disturbed(lambda pid: os.kill(pid, signal.SIGKILL))
        self.service.assert_as_before()


CLEAN = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


@pytest.fixture
def whole_bundle(tmp_path):
    subprocess.run([sys.executable, str(ROOT / ".ci/bundle.py"), "--out", str(tmp_path)], check=True)
    return next(tmp_path.glob("*.bundle"))


@pytest.fixture
def updated_boat(make_service, whole_bundle, tmp_path):
    """A boat under way with what was made of a whole bundle."""
    (place := tmp_path / "place").mkdir()
    (place / "bin").mkdir()
    (place / "opt").mkdir()
    bundle = unpack(whole_bundle, tmp_path / "first", None)
    first = Environment(place / "opt/rambler")
    with (tmp_path / "lock").open("w") as lock:
        make(first, tmp_path / "first", bundle, lock.fileno())
    (place / "bin/rambler").symlink_to(first.program)
    with make_service(program=(place / "bin/rambler",), environment={"PYTHONPATH": ""}) as service:
        service.under_way()
        yield UpdatedBoat(service, place)


@pytest.mark.proof
@pytest.mark.timeout(3600)
def test_real_bundles_forward_and_back_and_one_that_fails(updated_boat, whole_bundle, tmp_path):
    boat, ours = updated_boat, version_of_checkout()
    better = other_version(tmp_path, whole_bundle, "97.0.0", same)
    code, output = boat.update(better)
    assert (code, boat.version()) == (2, ours)
    assert "the boat is armed" in output
    boat.steers()
    for version, words in (
        ("97.0.0", (better, "--armed")),
        (ours, ("--back", "--armed")),
        ("97.0.0", ("--back", "--armed")),
    ):
        assert (boat.update(*words)[0], boat.version()) == (0, version)
        boat.steers()
    code, output = boat.update(other_version(tmp_path, whole_bundle, "98.0.0", cannot_be_imported), "--armed")
    assert (code, boat.version()) == (2, "97.0.0")
    assert "the new version cannot be imported: ImportError: no step" in output
    boat.steers()
    code, output = boat.update(other_version(tmp_path, whole_bundle, "99.0.0", dies_as_a_service), "--armed")
    assert (code, boat.version()) == (1, "97.0.0")
    assert "rolled back: rambler-99.0.0-" in output
    boat.steers()
    words = boat.service.log.read_text()
    assert "On trial: rambler-97.0.0-" in words
    assert "Trial passed: rambler-97.0.0-" in words
    assert "Update rolled back: rambler-99.0.0-" in words


@pytest.mark.proof
@pytest.mark.timeout(3600)
def test_real_updates_killed_at_any_moment(updated_boat, whole_bundle, tmp_path):
    """With pip at work, too; what it takes is measured by one that is not killed, at last."""
    boat, better = updated_boat, other_version(tmp_path, whole_bundle, "97.0.0", same)
    numbers = random.Random(20180825)
    for count in range(KILLS):
        begun_s = time.monotonic()
        process = subprocess.Popen(boat.command(better, "--armed"), stdout=subprocess.PIPE, text=True, env=CLEAN)
        try:
            output = process.communicate(timeout=numbers.uniform(0.0, UPDATE_S))[0]
        except subprocess.TimeoutExpired:
            process.kill()
            output = process.communicate()[0]
        boat.await_programs()
        last = (output.splitlines() or ["no output"])[-1]
        print(f"kill {count} after {time.monotonic() - begun_s:.1f} s: {last}")
        boat.steers()
        assert boat.version() in (version_of_checkout(), "97.0.0")
        if boat.version() == "97.0.0":
            break
    ended = boat.update(better, "--armed")
    if "is on trial" in ended[1] or "in force already" in ended[1]:
        return
    assert (ended[0], boat.version()) == (0, "97.0.0")
    boat.steers()


@pytest.mark.proof
@pytest.mark.timeout(1800)
@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk takes root")
def test_a_disk_that_is_full_or_gets_full_under_way(updated_boat, whole_bundle, tmp_path):
    """The environments are on a disk of their own, which is too small, or is filled while pip works."""
    boat, better = updated_boat, other_version(tmp_path, whole_bundle, "97.0.0", same)
    (small := tmp_path / "small").mkdir()
    for megabytes, wrong in ((300, "free space"), (600, "cannot be made")):
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(small)], check=True)
        try:
            shutil.copytree(boat.places / "opt/rambler", small / "rambler", symlinks=True)
            boat.link.unlink()
            boat.link.symlink_to(small / "rambler/bin/rambler")
            filler = threading.Thread(target=fill, args=(small,))
            filler.start()
            code, output = boat.update(better, "--armed")
            (small / "filled").write_bytes(b"")
            filler.join()
            assert code == 2, output
            assert wrong in output
            assert not list(small.glob("rambler-97*"))
            boat.steers()
        finally:
            boat.link.unlink()
            boat.link.symlink_to(boat.places / "opt/rambler/bin/rambler")
            subprocess.run(["umount", "--lazy", str(small)], check=True)


def fill(small):
    """Fill a disk once an environment is being made on it."""
    give_up_s = time.monotonic() + 60.0
    while not list(small.glob("rambler-97*/lib")):
        if time.monotonic() > give_up_s or (small / "filled").exists():
            return
        time.sleep(0.05)
    with contextlib.suppress(OSError), (small / "filled").open("wb") as file:
        while True:
            file.write(bytes(1 << 20))
            file.flush()
