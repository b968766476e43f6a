"""Which functions of numbers side by side give the bits that the C library of this machine gives.

Libraries differ, and one and the same chooses by the processor. So it is looked at, with drawn numbers, before code is
made that would take the functions of hil/lab/lane_functions.py for the library's.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from functools import cache
from random import Random
from typing import Any, Final, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba.core import codegen
from numpy.typing import NDArray

from hil.lab import lane_functions
from hil.lab.lanes import COUNT, VECTOR

Numbers = NDArray[np.float64]
DRAWN: Final = 1024  # multiples of COUNT


class Way(NamedTuple):
    """A way to compute a function: what makes the code, and between which numbers it does."""

    made: lane_functions.Made
    above: float
    below: float


def up_to(made: lane_functions.Made, reach: float) -> Way:
    """Return a way for numbers within a reach, of either sign."""
    return Way(made, -reach, reach)


class Row(NamedTuple):
    """A function of Python, the C library's, and the ways to compute it, the quickest first."""

    function: Callable[[float], float]
    ways: tuple[Way, ...]


TABLE: Final = (
    Row(math.exp, (up_to(lane_functions.exp, lane_functions.EXP_REACH),)),
    Row(
        math.sin,
        (
            up_to(lane_functions.small_sin, lane_functions.PLAIN),
            up_to(lane_functions.sin, lane_functions.ANGLE_REACH),
        ),
    ),
    Row(
        math.cos,
        (
            up_to(lane_functions.small_cos, lane_functions.PLAIN),
            up_to(lane_functions.cos, lane_functions.ANGLE_REACH),
        ),
    ),
    Row(math.tanh, (up_to(lane_functions.tanh, lane_functions.TANH_REACH),)),
    Row(math.log1p, (Way(lane_functions.log1p, lane_functions.LOG1P_ABOVE, lane_functions.LOG1P_REACH),)),
)


@cache
def drawn(above: float, below: float) -> Numbers:
    """Return numbers between two others, of either sign: evenly, about 1, and of every size."""
    source = Random(1)
    evenly = [source.uniform(above, below) for _ in range(DRAWN)]
    near = [source.uniform(max(above, -4.0), min(below, 4.0)) for _ in range(DRAWN)]
    sizes = [source.choice((above, below)) * 10.0 ** source.uniform(-20.0, 0.0) for _ in range(DRAWN)]
    return np.array([*evenly, *near, *sizes, *[0.0, -0.0] * (COUNT // 2)])


@cache
def given(function: Callable[[float], float], above: float, below: float) -> bytes:
    """Return what the library makes of the drawn numbers."""
    return np.array(list(map(function, drawn(above, below).tolist()))).tobytes()


def library() -> bytes:
    """Return what tells the libraries of two machines apart, as far as it matters here."""
    return b"".join(given(row.function, way.above, way.below) for row in TABLE for way in row.ways)


@cache
def ways_of(function: Callable[..., float]) -> tuple[Way, ...]:
    """Return the ways to compute a function that give the library's bits."""
    rows = [row for row in TABLE if row.function is function]
    return tuple(way for row in rows for way in row.ways if _computed(way) == given(function, way.above, way.below))


def _computed(way: Way) -> bytes:
    """Return what a way makes of the drawn numbers."""
    numbers = drawn(way.above, way.below)
    found = np.empty_like(numbers)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=str(codegen.get_host_cpu_features()),  # type: ignore[no-untyped-call]
    )
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(_module(way))), machine)
    engine.finalize_object()
    run = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)(engine.get_function_address("run"))
    run(numbers.ctypes.data, found.ctypes.data, numbers.size)
    return found.tobytes()


def _module(way: Way) -> Any:
    """Return code that computes so many numbers, a multiple of COUNT, from one place in memory to another."""
    module, place, count = ir.Module(), ir.DoubleType().as_pointer(), ir.IntType(64)
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [place, place, count]), "run")
    begin, loop, end = (function.append_basic_block(name) for name in ("begin", "loop", "end"))
    ir.IRBuilder(begin).branch(loop)
    build = ir.IRBuilder(loop)
    done = build.phi(count)
    source, target = (build.bitcast(build.gep(arg, [done]), VECTOR.as_pointer()) for arg in function.args[:2])
    build.store(way.made(build, build.load(source, align=8, typ=VECTOR)), target, align=8)
    after = build.add(done, ir.Constant(count, COUNT))
    done.add_incoming(ir.Constant(count, 0), begin)
    done.add_incoming(after, loop)
    build.cbranch(build.icmp_unsigned("<", after, function.args[2]), loop, end)
    ir.IRBuilder(end).ret_void()
    return module
