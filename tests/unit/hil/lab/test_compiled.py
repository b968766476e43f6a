"""The compiled functions are the plain ones, bit for bit."""

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

anything = st.floats(allow_nan=False, allow_infinity=False)
lag = anything.filter(lambda value: value != 0.0)


def bits(value):
    # All NaN are one: which of them an operation gives is not defined by IEEE 754.
    return "nan" if value != value else struct.pack("<d", value)  # noqa: PLR0124


@given(anything, anything, anything, lag, anything, anything)
def test_the_compiled_yaw_acceleration_is_the_plain_one_to_the_last_bit(r, rudder, ability, lag_s, norrbin, offset):
    arguments = (r, rudder, ability, lag_s, norrbin, offset)
    assert bits(yaw_acceleration(*arguments)) == bits(kt.yaw_acceleration(*arguments))


@given(st.tuples(anything, anything, anything, anything, anything, lag, anything, anything))
def test_the_compiled_runge_kutta_step_is_the_plain_one_to_the_last_bit(arguments):
    assert [bits(value) for value in rk4_step(*arguments)] == [bits(value) for value in kt.rk4_step(*arguments)]


@given(st.tuples(anything, anything, anything, anything, anything))
def test_the_compiled_exact_step_is_the_plain_one_to_the_last_bit(arguments):
    assert [bits(value) for value in exact_step(*arguments)] == [bits(value) for value in kt.exact_step(*arguments)]


def test_an_hour_compiled_is_an_hour_plain_to_the_last_bit():
    plain = fast = (0.0, 0.0)
    for number in range(36_000):
        rudder = 0.5 if number // 300 % 2 else -0.5
        plain = kt.rk4_step(*plain, rudder, 0.1, 0.049, 4.0, 17.0, 0.01)
        fast = rk4_step(*fast, rudder, 0.1, 0.049, 4.0, 17.0, 0.01)
    assert plain == fast


@given(st.floats(-1.6, 1.6), st.floats(1e-3, 10.0), st.floats(0.0, 1e4))
def test_the_compiled_steady_rate_is_the_plain_one_within_four_units_of_the_last_place(rudder, ability, norrbin):
    # Not to the last bit: Python takes r**3 with the C library's pow, the compiler multiplies.
    plain = kt.steady_yaw_rate(rudder, ability, norrbin)
    assert abs(steady_yaw_rate(rudder, ability, norrbin) - plain) <= 4.0 * np.spacing(abs(plain))


def test_a_planar_step_calls_the_same_equation_compiled():
    for function in (manoeuvring.planar_rates, manoeuvring._along):
        inner(function)
    step = compiled(manoeuvring.planar_step)
    plain = fast = (0.0, 0.0, 0.3, 0.01, 0.0)
    constants = (0.1, 0.4, 0.2, -0.1, 0.049, 4.0, 17.0, 0.01, -0.2, -0.12)
    for _ in range(1000):
        plain = manoeuvring.planar_step(plain, 0.5, *constants)
        fast = step(fast, 0.5, *constants)
    # Not to the last bit: the sine of the compiler is not everywhere the C library's.
    np.testing.assert_allclose(fast, plain, rtol=1e-12)
    assert fast[2:4] == plain[2:4]


def test_no_multiplication_is_fused_with_an_addition():
    fresh = compiled_here(kt.rk4_step)
    fresh(0.0, 0.0, 0.1, 0.1, 0.049, 4.0, 17.0, 0.0)
    assembler = "".join(fresh.inspect_asm().values())
    assert "mulsd" in assembler or "fmul" in assembler
    assert "vfmadd" not in assembler
    assert "fmadd" not in assembler


def test_division_by_zero_is_infinite_as_in_c():
    assert yaw_acceleration(0.0, 1.0, 1.0, 0.0, 0.0, 0.0) == np.inf


def double(value: float) -> float:
    return 2.0 * value


def test_without_a_place_for_machine_code_functions_are_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(compiled_module, "cache_folder", lambda _file: None)
    assert compiled(double)(3.0) == 6.0


def test_a_cache_that_cannot_be_made_is_none(monkeypatch, tmp_path):
    (tmp_path / "rambler-hil").write_text("a file where the folder should be")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert cache_folder.__wrapped__(HERE) is None


def test_the_cache_of_a_module_is_named_after_its_sources_and_its_old_ones_go(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    home = tmp_path / "rambler-hil"
    for number in range(6):
        for module in ("lab.test_compiled", "lab.other"):
            old = home / f"{module}-old{number}" / "inner"
            old.mkdir(parents=True)
            (old / "code").write_text("")
            os.utime(old.parent, (number, number))
    folder = cache_folder.__wrapped__(HERE)
    assert folder == home / f"lab.test_compiled-{sources_digest(HERE)}"
    kept = sorted(path.name for path in home.glob("lab.test_compiled-*"))
    assert kept == sorted([folder.name, *(f"lab.test_compiled-old{number}" for number in (3, 4, 5))])
    assert len(list(home.glob("lab.other-*"))) == 6


def test_old_machine_code_goes_and_what_another_program_may_use_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    now_s = time.time()
    for fifths in range(8):
        folder = tmp_path / "rambler-hil" / f"lab.test_compiled-{fifths} fifths of a day old"
        folder.mkdir(parents=True)
        (folder / "code").write_bytes(b"")
        os.utime(folder, (now_s, now_s - 0.2 * fifths * compiled_module.KEPT_S))
    found = cache_folder.__wrapped__(HERE)
    kept = {path.name for path in (tmp_path / "rambler-hil").iterdir()}
    assert kept == {found.name, *(f"lab.test_compiled-{fifths} fifths of a day old" for fifths in range(5))}


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """Copy both programs, and compute digests there."""
    for program in ("firmware_py", "hil"):
        shutil.copytree(ROOT / program, tmp_path / program, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compiled_module, "ROOT", tmp_path)
    compiled_module._source.cache_clear()
    yield tmp_path
    compiled_module._source.cache_clear()


def test_a_copy_of_the_sources_shares_the_machine_code(copied):
    before = sources_digest(copied / "hil/lab/tune/loop_kernel.py")
    os.utime(copied / "firmware_py/control/law.py", (0, 0))
    compiled_module._source.cache_clear()
    assert sources_digest(copied / "hil/lab/tune/loop_kernel.py") == before


@pytest.mark.parametrize(
    ("changed", "again"),
    [
        ("firmware_py/control/law.py", KERNELS),
        ("firmware_py/estimate/fixed_gain.py", KERNELS),  # from package import module
        ("firmware_py/model/kt.py", KERNELS),
        ("firmware_py/estimate/heading_filter.py", KERNELS),
        ("hil/lab/twin/pilot.py", {"twin/loop.py"}),
        ("hil/lab/tune/loop_kernel.py", {"tune/loop_kernel.py"}),
        ("firmware_py/control/__init__.py", KERNELS),  # could export a constant
        ("hil/lab/compiled.py", set()),
        ("firmware_py/common/parameter_table.py", set()),
    ],
)
def test_what_a_change_can_affect_is_compiled_again_and_nothing_else(copied, changed, again):
    kernels = [copied / "hil/lab" / name for name in sorted(KERNELS)]
    before = [sources_digest(kernel) for kernel in kernels]
    with (copied / changed).open("a") as file:
        file.write("# changed\n")
    compiled_module._source.cache_clear()
    after = [sources_digest(kernel) for kernel in kernels]
    found = {kernel for kernel, one, other in zip(kernels, before, after, strict=True) if one != other}
    assert {path.relative_to(copied / "hil/lab").as_posix() for path in found} == again


COMPILING = """
from firmware_py.model import kt
from hil.lab.compiled import compiled
f = compiled(kt.rk4_step)
f(0.0, 0.0, 0.1, 0.1, 0.05, 4.0, 17.0, 0.0)
print(sum(f.stats.cache_hits.values()), sum(f.stats.cache_misses.values()))
"""


def begun(cache):
    """Start a process that needs a compiled function."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.Popen(
        [sys.executable, "-c", COMPILING], cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True
    )


def test_a_process_waits_for_one_that_compiles_the_same_and_loads_it(tmp_path):
    assert begun(tmp_path / "first").communicate()[0].split() == ["0", "1"]
    (lock,) = (tmp_path / "first").rglob("*.lock")
    lock = tmp_path / "second" / lock.relative_to(tmp_path / "first")
    lock.parent.mkdir(parents=True)
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        second = begun(tmp_path / "second")
        waiting = re.compile(rf"-> FLOCK .* {second.pid} ")
        while not waiting.search(Path("/proc/locks").read_text()):
            assert second.poll() is None
        shutil.copytree(tmp_path / "first", tmp_path / "second", dirs_exist_ok=True)
    assert second.communicate()[0].split() == ["1", "0"]


class Terminal(io.StringIO):
    def __init__(self):
        super().__init__()
        self.told = threading.Event()

    def isatty(self):
        return True

    def write(self, text):
        self.told.set()
        return super().write(text)


def test_long_compilation_is_shown_on_a_terminal_and_then_its_time(monkeypatch):
    monkeypatch.setattr(compiled_module, "PATIENCE_S", 0.0)
    terminal = Terminal()
    with compiling("the test", terminal), event.trigger_event("numba:compile"), compiling("what is within", terminal):
        assert terminal.told.wait(10.0)
    assert "what is within" not in terminal.getvalue()
    assert "compiling the test for this machine" in terminal.getvalue()
    assert re.search(r"\r\x1b\[Kcompiled the test for this machine in \d+ s\n$", terminal.getvalue())


def test_short_compilation_says_nothing():
    terminal = Terminal()
    with compiling("the test", terminal):
        pass
    assert terminal.getvalue() == ""


def test_long_work_that_compiles_nothing_is_not_called_compilation(monkeypatch):
    looked = threading.Event()
    monkeypatch.setattr(compiled_module, "PATIENCE_S", 0.0)
    monkeypatch.setattr(compiled_module, "being_compiled", looked.set)
    terminal = Terminal()
    with compiling("the test", terminal):
        assert looked.wait(10.0)
    assert "compiling" not in terminal.getvalue()


def test_a_compilation_is_seen_as_such():
    @compiled_module.compiled_here
    def sum_of(a, b):
        return a + b

    seen = []

    class Listener(event.Listener):
        def on_start(self, event):
            seen.append(compiled_module.being_compiled())

        def on_end(self, event):
            pass

    with event.install_listener("numba:compile", Listener()):
        assert sum_of(1.0, 2.0) == 3.0
    assert seen == [True]
    assert not compiled_module.being_compiled()


def test_a_pipe_hears_nothing(monkeypatch):
    monkeypatch.setattr(compiled_module, "PATIENCE_S", 0.0)
    pipe = io.StringIO()
    before = threading.active_count()
    with compiling("the test", pipe):
        assert threading.active_count() == before
    assert pipe.getvalue() == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_until_the_compiler_is_left(number):
    passed = []

    def compile_until_told():
        with global_compiler_lock:
            with global_compiler_lock:
                passed.append("in")
            signal.raise_signal(number)
            passed.append("told")

    with interruptible():
        before = signal.getsignal(number)
        with pytest.raises(KeyboardInterrupt):
            compile_until_told()
        assert passed == ["in", "told"]
        assert signal.getsignal(number) is before


def test_an_error_while_compiling_ends_the_telling(monkeypatch):
    monkeypatch.setattr(compiled_module, "PATIENCE_S", 0.0)
    before = threading.active_count()
    with pytest.raises(ZeroDivisionError), compiling("the test", Terminal()):
        raise ZeroDivisionError
    assert threading.active_count() == before


def test_a_user_without_a_home_gets_no_folder_that_is_called_so(monkeypatch, tmp_path):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)  # as for one who is in no list of users
    monkeypatch.chdir(tmp_path)
    assert cache_folder.__wrapped__(HERE) is None
    assert list(tmp_path.iterdir()) == []


def test_an_old_folder_that_does_not_go_keeps_nobody_from_the_new_one(monkeypatch, tmp_path):
    def another_drops_it_too(_home, _module):
        raise FileNotFoundError

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled_module, "_drop_old", another_drops_it_too)
    assert cache_folder.__wrapped__(HERE) is not None


def test_code_that_cannot_be_kept_is_told_once_in_a_pipe_too(monkeypatch):
    monkeypatch.setattr(compiled_module, "_told", [])
    monkeypatch.setattr(compiled_module, "cache_folder", lambda _file: None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/nowhere")
    pipe = io.StringIO()
    for _ in range(2):
        with compiling("it", pipe):
            pass
    assert pipe.getvalue() == (
        "rambler-hil: machine code cannot be stored in /nowhere/rambler-hil and is compiled again by each process; "
        "NUMBA_CACHE_DIR can name another directory\n"
    )
