"""Functions of numbers side by side, and of single numbers by the same words: in each lane what C makes of it alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types

from firmware_py.common.angles import TWO_PI
from hil.lab import same_bits
from hil.lab.compiled import compiled
from hil.lab.lane_rows import tools
from hil.lab.lanes import COUNT, VECTOR, any_of, lanes, let, mask, typing, where


def _exactly(name: str) -> Callable[..., Any]:
    """Return what computes by an instruction that is exact, or rounded once."""

    def made(_context: Any, builder: Any, *args: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * len(args))
        return builder.call(tools.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{COUNT}f64"), args)

    return made


def _one_by_one(function: Callable[[float], float]) -> Callable[..., Any]:
    """Return what computes each lane as compiled code computes a number, which is to ask the C library."""
    alone = typing.signature(types.float64, types.float64)

    def made(context: Any, builder: Any, arg: Any) -> Any:
        compute, found = context.get_function(function, alone), ir.Constant(VECTOR, ir.Undefined)
        for lane in range(COUNT):
            place = ir.Constant(ir.IntType(32), lane)
            result = compute(builder, [builder.extract_element(arg, place)])
            found = builder.insert_element(found, result, place)
        return found

    return made


def _apart(name: str, made: Callable[..., Any]) -> Callable[..., Any]:
    """Return what calls the code for seldom cases, which stands once, out of the way."""

    def called(context: Any, builder: Any, arg: Any) -> Any:
        function = tools.get_or_insert_function(builder.module, ir.FunctionType(VECTOR, [VECTOR]), f"lanes.{name}")
        if function.is_declaration:
            function.linkage = "linkonce_odr"
            function.attributes.add("noinline")
            inside = ir.IRBuilder(function.append_basic_block())
            inside.ret(made(context, inside, function.args[0]))
        return builder.call(function, [arg])

    return called


def _as_the_library(function: Callable[[float], float]) -> Callable[..., Any]:
    """Return what computes the lanes beside each other, as far as that gives the bits of the C library."""
    name = function.__name__

    def made(context: Any, builder: Any, arg: Any) -> Any:
        seldom = _one_by_one(function)
        for number, way in reversed([*enumerate(same_bits.ways_of(function))]):
            seldom = _within_reach(way, _apart(f"{name}.{number}", seldom))
        return seldom(context, builder, arg)

    return made


def _within_reach(way: same_bits.Way, seldom: Callable[..., Any]) -> Callable[..., Any]:
    """Return what computes in a way, or otherwise if a number is out of its reach."""

    def made(context: Any, builder: Any, arg: Any) -> Any:
        ends = [("<=", way.above), (">=", way.below)]
        far = builder.or_(*(builder.fcmp_ordered(sign, arg, ir.Constant(VECTOR, [end] * COUNT)) for sign, end in ends))
        bits = builder.bitcast(far, ir.IntType(COUNT))
        found = []
        with builder.if_else(builder.icmp_unsigned("==", bits, ir.Constant(bits.type, 0)), likely=True) as (near, rest):
            with near:
                found.append((way.made(builder, arg), builder.block))
            with rest:
                found.append((seldom(context, builder, arg), builder.block))
        joined = builder.phi(VECTOR)
        for value, block in found:
            joined.add_incoming(value, block)
        return joined

    return made


def _is_nan(_context: Any, builder: Any, arg: Any) -> Any:
    return builder.fcmp_unordered("uno", arg, arg)


def _is_finite(context: Any, builder: Any, arg: Any) -> Any:
    return builder.fcmp_ordered("<", _exactly("fabs")(context, builder, arg), ir.Constant(VECTOR, [math.inf] * COUNT))


let(abs, _exactly("fabs"), lanes, lanes)
let(math.sqrt, _exactly("sqrt"), lanes, lanes)
let(math.floor, _exactly("floor"), lanes, lanes)
let(np.rint, _exactly("rint"), lanes, lanes)
let(math.copysign, _exactly("copysign"), lanes, lanes, lanes)
for _function in (math.exp, math.sin, math.cos, math.tanh, math.log1p):
    let(_function, _as_the_library(_function), lanes, lanes)
for _function in (math.expm1, math.log, math.tan):
    let(_function, _one_by_one(_function), lanes, lanes)
let(np.fmod, lambda _context, builder, *args: builder.frem(*args), lanes, lanes, lanes)
let(math.isnan, _is_nan, mask, lanes)
let(math.isfinite, _is_finite, mask, lanes)


@compiled
def least(one: Any, other: Any) -> Any:
    """Return the lesser of two numbers, as Python's min does."""
    return where(other < one, other, one)


@compiled
def most(one: Any, other: Any) -> Any:
    """Return the greater of two numbers, as Python's max does."""
    return where(other > one, other, one)


@compiled
def fails(condition: Any) -> Any:
    """Whether a condition does not hold."""
    return where(condition, False, True)


@compiled
def within(value: Any, low: Any, high: Any) -> Any:
    """Limit a number to [low, high]."""
    return where(value < low, low, where(value > high, high, value))


@compiled
def within_a_turn(angle_rad: Any) -> Any:
    """Return fmod(angle, 2 pi); within two turns a subtraction gives it exactly (Sterbenz) and faster."""
    less_rad, more_rad = angle_rad - TWO_PI, angle_rad + TWO_PI
    found_rad = where(angle_rad >= TWO_PI, less_rad, where(angle_rad <= -TWO_PI, more_rad, angle_rad))
    far = abs(angle_rad) >= 2.0 * TWO_PI
    if any_of(far):
        found_rad = where(far, np.fmod(angle_rad, TWO_PI), found_rad)
    return found_rad


@compiled
def wrap_pi(angle_rad: Any) -> Any:
    """Return the angle in [-pi, pi)."""
    turned_rad = within_a_turn(angle_rad + math.pi)
    wrapped_rad = where(turned_rad < 0.0, turned_rad + TWO_PI, turned_rad) - math.pi
    return where(wrapped_rad >= math.pi, -math.pi, wrapped_rad)


@compiled
def wrap_two_pi(angle_rad: Any) -> Any:
    """Return the angle in [0, 2 pi)."""
    turned_rad = within_a_turn(angle_rad)
    wrapped_rad = where(turned_rad < 0.0, turned_rad + TWO_PI, turned_rad)
    return where(wrapped_rad >= TWO_PI, 0.0, wrapped_rad)
