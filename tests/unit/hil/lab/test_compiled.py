"""Compiled functions: identity with plain ones to the last bit, storage of machine code, and progress."""

import fcntl
import io
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock

from firmware_py.model import kt
from hil.lab import compiled as compiled_module
from hil.lab.compiled import cache_folder, compiled, compiled_here, compiling, sources_digest
from hil.lab.numeric_core import inner
from hil.ship import manoeuvring
from hil.sim.signals import interruptible

ROOT, HERE = compiled_module.ROOT, Path(__file__)
KERNELS = {"tune/loop_kernel.py", "twin/loop.py", "identify/filter.py"}

yaw_acceleration = compiled(kt.yaw_acceleration)
rk4_step = compiled(kt.rk4_step)
exact_step = compiled(kt.exact_step)
steady_yaw_rate = compiled(kt.steady_yaw_rate)

any_float = st.floats(allow_nan=False, allow_infinity=False)
lag = any_float.filter(lambda value: value != 0.0)


def bits(value):
    # All NaN are equal: IEEE 754 does not define which of them an operation returns.
    return "nan" if value != value else struct.pack("<d", value)  # noqa: PLR0124


@given(any_float, any_float, any_float, lag, any_float, any_float)
def test_compiled_yaw_acceleration_equals_the_plain_one_to_the_last_bit(r, rudder, ability, lag_s, norrbin, offset):
    arguments = (r, rudder, ability, lag_s, norrbin, offset)
    assert bits(yaw_acceleration(*arguments)) == bits(kt.yaw_acceleration(*arguments))


@given(st.tuples(any_float, any_float, any_float, any_float, any_float, lag, any_float, any_float))
def test_compiled_runge_kutta_step_equals_the_plain_one_to_the_last_bit(arguments):
    assert [bits(value) for value in rk4_step(*arguments)] == [bits(value) for value in kt.rk4_step(*arguments)]


@given(st.tuples(any_float, any_float, any_float, any_float, any_float))
def test_compiled_exact_step_equals_the_plain_one_to_the_last_bit(arguments):
    assert [bits(value) for value in exact_step(*arguments)] == [bits(value) for value in kt.exact_step(*arguments)]


def test_an_hour_of_compiled_steps_equals_plain_steps_to_the_last_bit():
    plain = compiled_result = (0.0, 0.0)
    for number in range(36_000):
        rudder = 0.5 if number // 300 % 2 else -0.5
        plain = kt.rk4_step(*plain, rudder, 0.1, 0.049, 4.0, 17.0, 0.01)
        compiled_result = rk4_step(*compiled_result, rudder, 0.1, 0.049, 4.0, 17.0, 0.01)
    assert plain == compiled_result


@given(st.floats(-1.6, 1.6), st.floats(1e-3, 10.0), st.floats(0.0, 1e4))
def test_compiled_steady_rate_equals_the_plain_one_within_four_units_of_the_last_place(rudder, ability, norrbin):
    # Not to the last bit: Python computes r**3 with pow of the C library, the compiler multiplies.
    plain = kt.steady_yaw_rate(rudder, ability, norrbin)
    assert abs(steady_yaw_rate(rudder, ability, norrbin) - plain) <= 4.0 * np.spacing(abs(plain))


def test_compiled_planar_step_equals_the_plain_one():
    for function in (manoeuvring.planar_rates, manoeuvring._extrapolate):
        inner(function)
    step = compiled(manoeuvring.planar_step)
    plain = compiled_result = (0.0, 0.0, 0.3, 0.01, 0.0)
    constants = (0.1, 0.4, 0.2, -0.1, 0.049, 4.0, 17.0, 0.01, -0.2, -0.12)
    for _ in range(1000):
        plain = manoeuvring.planar_step(plain, 0.5, *constants)
        compiled_result = step(compiled_result, 0.5, *constants)
    # Not to the last bit: the sine of the compiler can differ from that of the C library.
    np.testing.assert_allclose(compiled_result, plain, rtol=1e-12)
    assert compiled_result[2:4] == plain[2:4]


def test_multiplications_are_not_fused_with_additions():
    unfused = compiled_here(kt.rk4_step)
    unfused(0.0, 0.0, 0.1, 0.1, 0.049, 4.0, 17.0, 0.0)
    assembler = "".join(unfused.inspect_asm().values())
    assert "mulsd" in assembler or "fmul" in assembler
    assert "vfmadd" not in assembler
    assert "fmadd" not in assembler


def test_compiled_division_by_zero_is_infinite():
    assert yaw_acceleration(0.0, 1.0, 1.0, 0.0, 0.0, 0.0) == np.inf


def twice(value: float) -> float:
    return 2.0 * value


def test_functions_are_compiled_without_a_cache_folder(monkeypatch):
    monkeypatch.setattr(compiled_module, "cache_folder", lambda _file: None)
    assert compiled(twice)(3.0) == 6.0


def test_cache_folder_is_none_if_it_cannot_be_created(monkeypatch, tmp_path):
    (tmp_path / "rambler-hil").write_text("a file where the folder should be")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert cache_folder.__wrapped__(HERE) is None


def test_cache_folder_is_named_after_the_sources_and_old_ones_are_deleted(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    home = tmp_path / "rambler-hil"
    for number in range(6):
        for module in ("lab.test_compiled", "lab.other"):
            old_folder = home / f"{module}-old{number}" / "inner"
            old_folder.mkdir(parents=True)
            (old_folder / "code").write_text("")
            os.utime(old_folder.parent, (number, number))
    folder = cache_folder.__wrapped__(HERE)
    assert folder == home / f"lab.test_compiled-{sources_digest(HERE)}"
    remaining = sorted(path.name for path in home.glob("lab.test_compiled-*"))
    assert remaining == sorted([folder.name, *(f"lab.test_compiled-old{number}" for number in (3, 4, 5))])
    assert len(list(home.glob("lab.other-*"))) == 6


def test_machine_code_of_the_last_day_is_not_deleted(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    now_s = time.time()
    for fifths in range(8):
        folder = tmp_path / "rambler-hil" / f"lab.test_compiled-{fifths} fifths of a day old"
        folder.mkdir(parents=True)
        (folder / "code").write_bytes(b"")
        os.utime(folder, (now_s, now_s - 0.2 * fifths * compiled_module.MIN_AGE_S))
    folder_found = cache_folder.__wrapped__(HERE)
    remaining = {path.name for path in (tmp_path / "rambler-hil").iterdir()}
    assert remaining == {folder_found.name, *(f"lab.test_compiled-{fifths} fifths of a day old" for fifths in range(5))}


@pytest.fixture
def copied_sources(tmp_path, monkeypatch):
    """Copy firmware_py and hil, and compute the digests of the copy."""
    for program in ("firmware_py", "hil"):
        shutil.copytree(ROOT / program, tmp_path / program, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compiled_module, "ROOT", tmp_path)
    compiled_module._source.cache_clear()
    yield tmp_path
    compiled_module._source.cache_clear()


def test_copy_of_the_sources_shares_the_machine_code(copied_sources):
    before = sources_digest(copied_sources / "hil/lab/tune/loop_kernel.py")
    os.utime(copied_sources / "firmware_py/control/law.py", (0, 0))
    compiled_module._source.cache_clear()
    assert sources_digest(copied_sources / "hil/lab/tune/loop_kernel.py") == before


@pytest.mark.parametrize(
    ("changed_file", "recompiled"),
    [
        ("firmware_py/control/law.py", KERNELS),
        ("firmware_py/estimate/fixed_gain.py", KERNELS),  # from package import module
        ("firmware_py/model/kt.py", KERNELS),
        ("firmware_py/estimate/heading_filter.py", KERNELS),
        ("hil/lab/twin/autopilot.py", {"twin/loop.py"}),
        ("hil/lab/tune/loop_kernel.py", {"tune/loop_kernel.py"}),
        ("firmware_py/control/__init__.py", KERNELS),  # could export a constant
        ("hil/lab/compiled.py", set()),
        ("firmware_py/common/parameter_table.py", set()),
    ],
)
def test_change_recompiles_only_functions_that_it_can_affect(copied_sources, changed_file, recompiled):
    kernels = [copied_sources / "hil/lab" / name for name in sorted(KERNELS)]
    before = [sources_digest(kernel) for kernel in kernels]
    with (copied_sources / changed_file).open("a") as file:
        file.write("# changed\n")
    compiled_module._source.cache_clear()
    after = [sources_digest(kernel) for kernel in kernels]
    changed_kernels = {
        kernel
        for kernel, digest_before, digest_after in zip(kernels, before, after, strict=True)
        if digest_before != digest_after
    }
    assert {path.relative_to(copied_sources / "hil/lab").as_posix() for path in changed_kernels} == recompiled


COMPILING = """
from firmware_py.model import kt
from hil.lab.compiled import compiled
f = compiled(kt.rk4_step)
f(0.0, 0.0, 0.1, 0.1, 0.05, 4.0, 17.0, 0.0)
print(sum(f.stats.cache_hits.values()), sum(f.stats.cache_misses.values()))
"""


def start_process(cache):
    """Start a process that needs a compiled function."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", COMPILING], cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    )


def test_process_waits_for_another_that_compiles_the_same_function(tmp_path):
    assert start_process(tmp_path / "first").communicate()[0].split() == ["0", "1"]
    (lock,) = (tmp_path / "first").rglob("*.lock")
    lock = tmp_path / "second" / lock.relative_to(tmp_path / "first")
    lock.parent.mkdir(parents=True)
    with lock.open("w") as lock_file:
        fcntl.flock(lock_file, fcntl.LOCK_EX)
        second = start_process(tmp_path / "second")
        waiting = re.compile(rf"-> FLOCK .* {second.pid} ")
        while not waiting.search(Path("/proc/locks").read_text()):
            assert second.poll() is None
        shutil.copytree(tmp_path / "first", tmp_path / "second", dirs_exist_ok=True)
    assert second.communicate()[0].split() == ["1", "0"]


class Terminal(io.StringIO):
    def __init__(self):
        super().__init__()
        self.written = threading.Event()

    def isatty(self):
        return True

    def write(self, text):
        self.written.set()
        return super().write(text)


def test_terminal_shows_a_long_compilation_and_its_time(monkeypatch):
    monkeypatch.setattr(compiled_module, "PROGRESS_DELAY_S", 0.0)
    terminal = Terminal()
    with compiling("the test", terminal), event.trigger_event("numba:compile"), compiling("the inner block", terminal):
        assert terminal.written.wait(10.0)
    assert "the inner block" not in terminal.getvalue()
    assert "compiling the test for this machine" in terminal.getvalue()
    assert re.search(r"\r\x1b\[Kcompiled the test for this machine in \d+ s\n$", terminal.getvalue())


def test_short_compilation_prints_nothing():
    terminal = Terminal()
    with compiling("the test", terminal):
        pass
    assert terminal.getvalue() == ""


def test_work_without_compilation_prints_nothing(monkeypatch):
    checked = threading.Event()
    monkeypatch.setattr(compiled_module, "PROGRESS_DELAY_S", 0.0)
    monkeypatch.setattr(compiled_module, "being_compiled", checked.set)
    terminal = Terminal()
    with compiling("the test", terminal):
        assert checked.wait(10.0)
    assert "compiling" not in terminal.getvalue()


def test_being_compiled_is_true_during_a_compilation():
    @compiled_module.compiled_here
    def sum_of(a, b):
        return a + b

    states = []

    class Listener(event.Listener):
        def on_start(self, event):
            states.append(compiled_module.being_compiled())

        def on_end(self, event):
            pass

    with event.install_listener("numba:compile", Listener()):
        assert sum_of(1.0, 2.0) == 3.0
    assert states == [True]
    assert not compiled_module.being_compiled()


def test_compilation_prints_nothing_to_a_pipe(monkeypatch):
    monkeypatch.setattr(compiled_module, "PROGRESS_DELAY_S", 0.0)
    pipe = io.StringIO()
    before = threading.active_count()
    with compiling("the test", pipe):
        assert threading.active_count() == before
    assert pipe.getvalue() == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_is_deferred_until_the_compiler_ends(number):
    steps_done = []

    def compile_and_raise():
        with global_compiler_lock:
            with global_compiler_lock:
                steps_done.append("in")
            signal.raise_signal(number)
            steps_done.append("raised")

    with interruptible():
        before = signal.getsignal(number)
        with pytest.raises(KeyboardInterrupt):
            compile_and_raise()
        assert steps_done == ["in", "raised"]
        assert signal.getsignal(number) is before


def test_error_ends_the_progress_thread(monkeypatch):
    monkeypatch.setattr(compiled_module, "PROGRESS_DELAY_S", 0.0)
    before = threading.active_count()
    with pytest.raises(ZeroDivisionError), compiling("the test", Terminal()):
        raise ZeroDivisionError
    assert threading.active_count() == before


def test_user_without_a_home_directory_has_no_cache_folder(monkeypatch, tmp_path):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for a user without an entry in /etc/passwd
    monkeypatch.chdir(tmp_path)
    assert cache_folder.__wrapped__(HERE) is None
    assert list(tmp_path.iterdir()) == []


def test_old_folder_that_another_process_deletes_is_ignored(monkeypatch, tmp_path):
    def already_deleted(_home, _module):
        raise FileNotFoundError

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled_module, "_delete_old_folders", already_deleted)
    assert cache_folder.__wrapped__(HERE) is not None


def test_missing_storage_is_reported_once_also_in_a_pipe(monkeypatch):
    monkeypatch.setattr(compiled_module, "_warning_printed", threading.Event())
    monkeypatch.setattr(compiled_module, "cache_folder", lambda _file: None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/nowhere")
    pipe = io.StringIO()
    for _ in range(2):
        with compiling("it", pipe):
            pass
    assert pipe.getvalue() == (
        "rambler-hil: machine code cannot be stored in /nowhere/rambler-hil, so each process compiles it again; "
        "set NUMBA_CACHE_DIR to another directory\n"
    )
