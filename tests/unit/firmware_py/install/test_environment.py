"""Virtual environments of the versions: free space, programs that fail, and the list of the bundle."""

import os
import subprocess
import zipfile
from types import SimpleNamespace

import pytest

from firmware_py.install import environment
from firmware_py.install.bundle import UpdateError
from firmware_py.install.environment import Environment, check_free_space, create_work_directory


def write_wheel(path, size):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(size - 1000))
        archive.writestr("b", bytes(1000))


def test_update_needs_the_unpacked_and_compiled_size_and_fifty_megabytes(tmp_path, monkeypatch):
    """Of the wheels of a package one is installed; compiled modules add 60 %."""
    for name, size in (("a-1-cp311-any.whl", 1_000_000), ("a-1-cp313-any.whl", 900_000), ("b-1-any.whl", 500_000)):
        write_wheel(tmp_path / name, size)
    free_bytes = [52_400_000, 52_399_999]
    monkeypatch.setattr(environment.shutil, "disk_usage", lambda _path: SimpleNamespace(free=free_bytes.pop(0)))
    check_free_space(Environment(tmp_path / "rambler"), tmp_path)
    with pytest.raises(UpdateError, match=r"has 52 MB free, an update needs 52 MB; free space"):
        check_free_space(Environment(tmp_path / "rambler"), tmp_path)
    (tmp_path / "c-1-any.whl").write_bytes(b"text")
    with pytest.raises(UpdateError, match=r"c-1-any\.whl is not a wheel"):
        check_free_space(Environment(tmp_path / "rambler"), tmp_path)


def test_failed_program_is_an_error_with_its_first_error_line(tmp_path):
    with (tmp_path / "lock").open("w") as lock:
        environment._run(["test", "-e", f"/proc/self/fd/{lock.fileno()}"], lock.fileno())  # it keeps the lock
        for command, text in (
            ("echo out; exit 3", "the new environment cannot be made: out"),
            ("echo out; echo one >&2; echo ERROR: two >&2; exit 3", "the new environment cannot be made: ERROR: two"),
            ("echo out; printf %0301d 0 >&2; exit 3", f"the new environment cannot be made: {'0' * 300}"),
            ("exit 3", "the new environment cannot be made: exit code 3"),
        ):
            with pytest.raises(UpdateError) as error:
                environment._run(["sh", "-c", command], lock.fileno())
            assert str(error.value) == text
        with pytest.raises(UpdateError, match="/no/such/program: "):
            environment._run(["/no/such/program"], lock.fileno())


def test_program_that_hangs_is_ended_after_twenty_minutes(monkeypatch):
    def run(command, *, timeout, **_options):
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(environment.subprocess, "run", run)
    with pytest.raises(UpdateError, match="timed out after 1200"):
        environment._run(["pip"], 0)


def test_python_without_venv_has_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setattr(environment.importlib.util, "find_spec", lambda _name: None)
    with pytest.raises(UpdateError, match="apt-get install python3-venv"):
        environment.create(Environment(tmp_path), tmp_path, None, 0)


def test_environment_that_is_partly_removed_is_not_complete(tmp_path, monkeypatch):
    (tmp_path / "bundle.json").touch()
    monkeypatch.setattr(environment.shutil, "rmtree", lambda _path: pytest.fail("killed"))
    with pytest.raises(pytest.fail.Exception):
        environment._remove(tmp_path)
    assert not (tmp_path / "bundle.json").exists()


def test_work_directory_is_empty_and_private(tmp_path):
    for _ in range(2):
        folder = create_work_directory(Environment(tmp_path / "rambler"))
        assert (list(folder.iterdir()), folder.stat().st_mode & 0o777) == ([], 0o700)
        (folder / "left").mkdir()


def test_list_of_a_bundle_beyond_its_size_limit_is_not_read(tmp_path):
    (tmp_path / "bundle.json").write_bytes(
        b'{"format": 1, "version": "1.0.0", "commit": "", "commit_utc_s": 0, "files": {}}'
    )
    assert Environment(tmp_path).bundle().version == "1.0.0"
    with (tmp_path / "bundle.json").open("ab") as file:
        file.write(b" " * ((1 << 20) + 1 - file.tell()))
    assert Environment(tmp_path).bundle() is None
    os.truncate(tmp_path / "bundle.json", 1 << 20)
    assert Environment(tmp_path).bundle().version == "1.0.0"
