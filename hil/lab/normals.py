"""Standard normal numbers in compiled code, bit-identical to numpy.random.Generator(PCG64) and faster.

PCG64 (O'Neill, pcg-random.org: XSL RR 128/64) and the ziggurat (Marsaglia and Tsang, J. Stat. Soft. 5(8), 2000) with
numpy's tables, as numba has them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numba.extending
import numpy as np
from llvmlite import ir
from numba.core import types as numba_types
from numba.np.random import _constants as tables
from numpy.typing import NDArray

from hil.lab.compiled import compiled

MULTIPLIER: Final = (2549297995355413924 << 64) + 4865540595714422341
WORD_BITS: Final = 64
types: Any = numba_types
extending: Any = numba.extending  # numba's tools are untyped
INSIDE_LIMITS, WIDTHS, HEIGHTS = tables.ki_double, tables.wi_double, tables.fi_double
TAIL: Final = float(tables.ziggurat_nor_r)
TAIL_INVERSE: Final = float(tables.ziggurat_nor_inv_r)
UNIT_STEP: Final = 1.0 / 9007199254740992.0  # 2**-53


def _next_state(_typing: Any, high: Any, low: Any, add_high: Any, add_low: Any) -> Any:
    """Define the intrinsic function that returns the high and the low half of the next state."""
    wide, word = ir.IntType(2 * WORD_BITS), ir.IntType(WORD_BITS)

    def generate_code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        high, low, add_high, add_low = (builder.zext(arg, wide) for arg in args)
        shift = ir.Constant(wide, WORD_BITS)
        state, add = builder.or_(builder.shl(high, shift), low), builder.or_(builder.shl(add_high, shift), add_low)
        state = builder.add(builder.mul(state, ir.Constant(wide, MULTIPLIER)), add)
        halves = [builder.trunc(builder.lshr(state, shift), word), builder.trunc(state, word)]
        return context.make_tuple(builder, signature.return_type, halves)

    return types.UniTuple(types.uint64, 2)(high, low, add_high, add_low), generate_code


next_state: Callable[[int, int, int, int], tuple[int, int]] = extending.intrinsic(_next_state)


@compiled
def word_of(high: Any, low: Any) -> Any:
    """Return the random 64-bit word of a state."""
    mixed, rotation = high ^ low, high >> np.uint64(58)
    return (mixed >> rotation) | (mixed << ((np.uint64(64) - rotation) & np.uint64(63)))


@compiled
def unit_of(word: Any) -> float:
    """Return the number in [0, 1) of a random word."""
    return float(np.float64(word >> np.uint64(11)) * UNIT_STEP)


@compiled
def fill(state: NDArray[np.uint64], numbers: NDArray[np.float64]) -> None:
    """Compute normal numbers into `numbers`; `state` (state and increment of the generator, in halves) is advanced."""
    high, low, add_high, add_low = state[0], state[1], state[2], state[3]
    filled = 0
    while filled < numbers.size:
        high, low = next_state(high, low, add_high, add_low)
        word = word_of(high, low)
        layer, mantissa = np.int64(word & np.uint64(0xFF)), (word >> np.uint64(9)) & np.uint64(0xFFFFFFFFFFFFF)
        number = np.float64(mantissa) * WIDTHS[layer]
        if word >> np.uint64(8) & np.uint64(1):
            number = -number
        is_accepted = mantissa < INSIDE_LIMITS[layer]
        if not is_accepted:
            high, low = next_state(high, low, add_high, add_low)
            unit = unit_of(word_of(high, low))
            if layer > 0:
                height = (HEIGHTS[layer - 1] - HEIGHTS[layer]) * unit + HEIGHTS[layer]
                is_accepted = height < math.exp(-0.5 * number * number)
            while layer == 0 and not is_accepted:
                high, low = next_state(high, low, add_high, add_low)
                tail_distance = -TAIL_INVERSE * math.log1p(-unit)
                depth = -math.log1p(-unit_of(word_of(high, low)))
                is_accepted = depth + depth > tail_distance * tail_distance
                if is_accepted:
                    number = (
                        -(TAIL + tail_distance) if mantissa >> np.uint64(8) & np.uint64(1) else TAIL + tail_distance
                    )
                else:
                    high, low = next_state(high, low, add_high, add_low)
                    unit = unit_of(word_of(high, low))
        if is_accepted:
            numbers[filled] = number
            filled += 1
    state[0], state[1] = high, low


def draw_normals(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return the next normal numbers of a generator without advancing it."""
    numbers = np.empty(count)
    fill(state_of(rng), numbers)
    return numbers


def state_of(rng: np.random.Generator) -> NDArray[np.uint64]:
    """Return the state of a generator in the form for `fill`."""
    state = rng.bit_generator.state["state"]
    halves = [divmod(state[name], 1 << WORD_BITS) for name in ("state", "inc")]
    return np.array(halves, np.uint64).ravel()
