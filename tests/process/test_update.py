"""An update that ends at any step leaves an autopilot that steers, and the next update succeeds."""

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
from firmware_py.install.environment import Environment, create
from support.paths import ROOT
from support.small_bundle import load_bundle_maker, small_bundle

KILLS = int(os.environ.get("UPDATE_KILLS", "10"))
TYPICAL_UPDATE_S = 40.0  # typical time until the trial, on two busy cores
MEMORY_DISK = Path("/dev/shm")  # faster than the disk


def end_at_every_step(tmp_path, kind, code=0, every=1):
    """Return the outcomes of updates that end at every n-th step (support/killed_update.py).

    `code`: exit code of the new version.
    """
    program, bundle = Path(ROOT) / "tests/support/killed_update.py", small_bundle(tmp_path, code)
    with tempfile.TemporaryDirectory(dir=MEMORY_DISK if MEMORY_DISK.is_dir() else None) as folder:
        command = [sys.executable, str(program), folder, str(bundle), kind, str(every)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        process = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    steps = [json.loads(line) for line in process.stdout.splitlines()]
    assert steps[-1]["how"] == "done"
    return steps


@pytest.mark.parametrize(
    ("kind", "result", "every"),
    [("kill", "killed", 6), ("full", "refused", 1), pytest.param("kill", "killed", 1, marks=pytest.mark.proof)],
)
def test_update_that_ends_at_any_step_leaves_an_autopilot_that_steers_and_updates(tmp_path, kind, result, every):
    steps = end_at_every_step(tmp_path, kind, every=every)
    assert len(steps) > {"kill": 100, "full": 15}[kind] / every, "too few steps"
    for step in steps[:-1]:
        assert step["how"] == result, step
        # The first start steers with either version; a failed trial ends with the previous one.
        assert set(step["starts"]) <= {"steers old", "steers new"}, step
        assert step["starts"][-1] == "steers old", step
        assert step["closed"] == [], step
        assert (step["again"], step["starts again"]) == ("done", ["steers new"] * 2), step
        assert len(step["left"]) == 2, step
    assert steps[-1]["starts"] == ["steers new"] * 3 + ["steers old"]


@pytest.mark.parametrize("every", [16, pytest.param(1, marks=pytest.mark.proof)])
def test_version_that_does_not_start_is_rolled_back(tmp_path, every):
    steps = end_at_every_step(tmp_path, "kill", code=1, every=every)
    for step in steps:
        assert step["starts"] in (["steers old"] * 4, [""] * 3 + ["steers old"]), step
    assert steps[-1]["starts"][0] == ""


def version_of_checkout():
    return re.search(r'__version__ = "(.*)"', (ROOT / "firmware_py/__init__.py").read_text())[1]


def make_other_version(folder, whole_bundle_path, version, change, drivers=()):
    """Make a bundle of this checkout as another version with changed files, and the packages of a complete bundle.

    `drivers` are wheels of driver packages.
    """
    tree = folder / f"tree-{version}"
    ignore = shutil.ignore_patterns(".git", ".venv", "build", "tests", "docs", "__pycache__", ".mypy_cache")
    shutil.copytree(ROOT, tree, ignore=ignore)
    file = tree / "firmware_py/__init__.py"
    file.write_text(file.read_text().replace(version_of_checkout(), version))
    change(tree)
    unpack(whole_bundle_path, wheels := folder / f"wheels-{version}", None)
    next(wheels.glob("rambler_autopilot-*.whl")).unlink()
    maker = load_bundle_maker()
    maker.run_pip("wheel", "--no-deps", "--wheel-dir", wheels, tree)
    wheel = next(wheels.glob("rambler_autopilot-*.whl"))
    text = maker.LOCK_FILE.read_text() + "".join(map(maker.lock_line, [wheel, *drivers]))
    for driver in drivers:
        shutil.copy(driver, wheels)
    (wheels / "requirements.txt").write_text(text)
    (wheels / "bundle.json").unlink()
    maker.write_bundle(wheels, target := folder / f"{version}.bundle", version, "", int(time.time()))
    return target


def change_nothing(_tree):
    """Leave the files as they are."""


def break_service(tree):
    """Make the version pass the tests before the trial and exit as a service."""
    file = tree / "firmware_py/cli/run.py"
    text = file.read_text()
    file.write_text(
        text.replace(
            "def run(arguments", 'if "RUNTIME_DIRECTORY" in os.environ:\n    sys.exit(3)\n\n\ndef run(arguments'
        )
    )
    file.write_text(file.read_text().replace("import os\n", "import os\nimport sys\n", 1))


def break_import(tree):
    (tree / "firmware_py/core/step.py").write_text("raise ImportError('no step')\n")


class UpdatedBoat:
    """A boat on its mission, whose service runs the program of a symbolic link that updates change."""

    def __init__(self, service, directory):
        self.service, self.link = service, directory / "bin/rambler"
        self.directory = directory

    def command(self, *options):
        return [str(self.link), "update", *map(str, options), "--unit", str(self.service.unit)]

    def update(self, *options):
        """Run `rambler update`; return exit code and output."""
        process = subprocess.run(
            self.command(*options), capture_output=True, text=True, env=CLEAN_ENVIRONMENT, check=False
        )
        print(process.stdout + process.stderr)
        return process.returncode, process.stdout + process.stderr

    def wait_for_lock(self):
        """Wait for the lock, which pip of a killed update releases at its end."""
        descriptor = os.open(self.link.parent, os.O_RDONLY)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        os.close(descriptor)

    def version(self):
        process = subprocess.run(
            [str(self.link), "--version"], capture_output=True, text=True, check=True, env=CLEAN_ENVIRONMENT
        )
        return process.stdout.split()[1]

    def assert_steers(self):
        """Check that the boat continues its mission, also after a kill."""
        self.service.goals.first_after(time.monotonic())
        self.service.assert_state_kept()
        self.service.disturb_run(lambda pid: os.kill(pid, signal.SIGKILL))
        self.service.assert_state_kept()


CLEAN_ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


@pytest.fixture
def whole_bundle(tmp_path):
    subprocess.run([sys.executable, str(ROOT / ".ci/bundle.py"), "--out", str(tmp_path)], check=True)
    return next(tmp_path.glob("*.bundle"))


@pytest.fixture
def updated_boat(make_service, whole_bundle, tmp_path):
    """A boat under way with the version of a complete bundle."""
    (directory := tmp_path / "place").mkdir()
    (directory / "bin").mkdir()
    (directory / "opt").mkdir()
    bundle = unpack(whole_bundle, tmp_path / "first", None)
    environment = Environment(directory / "opt/rambler")
    with (tmp_path / "lock").open("w") as lock:
        create(environment, tmp_path / "first", bundle, lock.fileno())
    (directory / "bin/rambler").symlink_to(environment.program)
    with make_service(program=(directory / "bin/rambler",), environment={"PYTHONPATH": ""}) as service:
        service.get_under_way()
        yield UpdatedBoat(service, directory)


@pytest.mark.proof
@pytest.mark.timeout(3600)
def test_real_updates_succeed_return_and_roll_back(updated_boat, whole_bundle, tmp_path):
    boat, own_version = updated_boat, version_of_checkout()
    new_bundle = make_other_version(tmp_path, whole_bundle, "97.0.0", change_nothing)
    code, output = boat.update(new_bundle)
    assert (code, boat.version()) == (2, own_version)
    assert "the boat is armed" in output
    boat.assert_steers()
    for version, options in (
        ("97.0.0", (new_bundle, "--armed")),
        (own_version, ("--back", "--armed")),
        ("97.0.0", ("--back", "--armed")),
    ):
        assert (boat.update(*options)[0], boat.version()) == (0, version)
        boat.assert_steers()
    code, output = boat.update(make_other_version(tmp_path, whole_bundle, "98.0.0", break_import), "--armed")
    assert (code, boat.version()) == (2, "97.0.0")
    assert "the new version cannot be imported: ImportError: no step" in output
    boat.assert_steers()
    code, output = boat.update(make_other_version(tmp_path, whole_bundle, "99.0.0", break_service), "--armed")
    assert (code, boat.version()) == (1, "97.0.0")
    assert "rolled back: rambler-99.0.0-" in output
    boat.assert_steers()
    log_text = boat.service.log.read_text()
    assert "On trial: rambler-97.0.0-" in log_text
    assert "Trial passed: rambler-97.0.0-" in log_text
    assert "Update rolled back: rambler-99.0.0-" in log_text


@pytest.mark.proof
@pytest.mark.timeout(1800)
def test_driver_package_survives_an_update_and_the_return(updated_boat, whole_bundle, tmp_path):
    boat = updated_boat
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    source = shutil.copytree(ROOT / "docs/how-to/os5000", tmp_path / "os5000")
    subprocess.run([*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", str(tmp_path), str(source)], check=True)
    (wheel,) = tmp_path.glob("rambler_os5000-*.whl")
    python = boat.link.resolve().parent / "python"
    subprocess.run([*pip, "--python", str(python), "install", "--no-deps", str(wheel)], check=True)

    def is_driver_installed():
        command = [str(boat.link.resolve().parent / "python"), "-I", "-c", "import rambler_os5000"]
        return subprocess.run(command, check=False, env=CLEAN_ENVIRONMENT).returncode == 0

    bare_bundle = make_other_version(tmp_path, whole_bundle, "97.0.0", change_nothing)
    code, output = boat.update(bare_bundle, "--armed")
    assert (code, boat.version()) == (2, version_of_checkout())
    assert "the bundle lacks the installed driver package rambler-os5000 1.0" in output
    boat.assert_steers()
    bundle = make_other_version(tmp_path, whole_bundle, "98.0.0", change_nothing, [wheel])
    for version, options in (("98.0.0", (bundle, "--armed")), (version_of_checkout(), ("--back", "--armed"))):
        assert (boat.update(*options)[0], boat.version()) == (0, version)
        assert is_driver_installed()
        boat.assert_steers()


@pytest.mark.proof
@pytest.mark.timeout(3600)
def test_real_updates_killed_at_any_moment(updated_boat, whole_bundle, tmp_path):
    """Kills also hit pip. The last update is not killed."""
    boat, new_bundle = updated_boat, make_other_version(tmp_path, whole_bundle, "97.0.0", change_nothing)
    rng = random.Random(20180825)
    for count in range(KILLS):
        start_s = time.monotonic()
        process = subprocess.Popen(
            boat.command(new_bundle, "--armed"), stdout=subprocess.PIPE, text=True, env=CLEAN_ENVIRONMENT
        )
        try:
            output = process.communicate(timeout=rng.uniform(0.0, TYPICAL_UPDATE_S))[0]
        except subprocess.TimeoutExpired:
            process.kill()
            output = process.communicate()[0]
        boat.wait_for_lock()
        last_line = (output.splitlines() or ["no output"])[-1]
        print(f"kill {count} after {time.monotonic() - start_s:.1f} s: {last_line}")
        boat.assert_steers()
        assert boat.version() in (version_of_checkout(), "97.0.0")
        if boat.version() == "97.0.0":
            break
    result = boat.update(new_bundle, "--armed")
    if "is on trial" in result[1] or "in force already" in result[1]:
        return
    assert (result[0], boat.version()) == (0, "97.0.0")
    boat.assert_steers()


@pytest.mark.proof
@pytest.mark.timeout(1800)
@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk needs root")
def test_update_on_a_disk_that_is_or_becomes_full_is_refused(updated_boat, whole_bundle, tmp_path):
    """The environments are on a separate disk, which is too small or is filled while pip runs."""
    boat, new_bundle = updated_boat, make_other_version(tmp_path, whole_bundle, "97.0.0", change_nothing)
    (small_disk := tmp_path / "small").mkdir()
    for megabytes, text in ((300, "free space"), (600, "cannot be made")):
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(small_disk)], check=True)
        try:
            shutil.copytree(boat.directory / "opt/rambler", small_disk / "rambler", symlinks=True)
            boat.link.unlink()
            boat.link.symlink_to(small_disk / "rambler/bin/rambler")
            filler = threading.Thread(target=fill_disk, args=(small_disk,))
            filler.start()
            code, output = boat.update(new_bundle, "--armed")
            (small_disk / "filled").write_bytes(b"")
            filler.join()
            assert code == 2, output
            assert text in output
            assert not list(small_disk.glob("rambler-97*"))
            boat.assert_steers()
        finally:
            boat.link.unlink()
            boat.link.symlink_to(boat.directory / "opt/rambler/bin/rambler")
            subprocess.run(["umount", "--lazy", str(small_disk)], check=True)


def fill_disk(small_disk):
    """Fill a disk when an environment appears on it."""
    give_up_s = time.monotonic() + 60.0
    while not list(small_disk.glob("rambler-97*/lib")):
        if time.monotonic() > give_up_s or (small_disk / "filled").exists():
            return
        time.sleep(0.05)
    with contextlib.suppress(OSError), (small_disk / "filled").open("wb") as file:
        while True:
            file.write(bytes(1 << 20))
            file.flush()
