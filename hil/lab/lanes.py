"""Numbers side by side, for compiled code: eight simulations in one vector, each with the bits that it has alone.

An equation that is written for a number is compiled for these lanes as well: the sum of two vectors is the sum of each
pair, and no order of operations changes. What has no exact instruction for vectors is computed lane by lane instead.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numba.extending
import numpy as np
from llvmlite import ir
from numba.core import cgutils, typeconv, types
from numba.core.typing import templates
from numpy.typing import NDArray

COUNT: Final = 8  # numbers of 64 bits in a register of 512; of smaller registers it takes several
VECTOR: Final = ir.VectorType(ir.DoubleType(), COUNT)
ALIGNED_BYTES: Final = 64
extending: Any = numba.extending  # numba's tools are untyped
typing: Any = templates
tools: Any = cgutils
conversions: Any = typeconv


class LanesType(types.Type):
    """The type of numbers side by side."""

    def __init__(self) -> None:
        """Be the one type of its kind."""
        super().__init__(name="Lanes")

    def can_convert_from(self, _typing: object, other: object) -> Any:
        """Let one number be the number of every lane."""
        return conversions.Conversion.safe if isinstance(other, types.Float | types.Integer) else None


lanes: Any = LanesType()


@extending.register_model(LanesType)
class LanesModel(extending.models.PrimitiveModel):  # type: ignore[misc]
    """A vector of the processor."""

    def __init__(self, manager: object, kind: object) -> None:
        """Take what numba hands to a model."""
        super().__init__(manager, kind, VECTOR)


def _from_number(context: Any, builder: Any, kind: Any, _to: Any, value: Any) -> Any:
    nothing = ir.Constant(VECTOR, ir.Undefined)
    number = context.cast(builder, value, kind, types.float64)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), COUNT), [0] * COUNT))


for _kind in (types.Float, types.Integer):
    extending.lower_cast(_kind, LanesType)(_from_number)


def _let(name: Callable[..., Any], instruction: str, count: int) -> None:
    """Let an operator of Python be an instruction for vectors."""

    class Typing(typing.AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, _named: Any) -> Any:
            return typing.signature(lanes, *[lanes] * count) if lanes in args and len(args) == count else None

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)

    typing.infer_global(name)(Typing)
    extending.lower_builtin(name, *[LanesType] * count)(made)


_let(operator.add, "fadd", 2)
_let(operator.sub, "fsub", 2)
_let(operator.mul, "fmul", 2)
_let(operator.truediv, "fdiv", 2)
_let(operator.neg, "fneg", 1)


def _pointer(context: Any, builder: Any, known: Any, args: Any) -> Any:
    row = context.cast(builder, args[1], known.args[1], types.intp)
    data = context.make_array(known.args[0])(context, builder, args[0]).data
    return builder.bitcast(builder.gep(data, [builder.mul(row, ir.Constant(row.type, COUNT))]), VECTOR.as_pointer())


def _lanes_of(_typing: Any, array: Any, row: Any) -> Any:
    """Return a row of an array whose last axis is the lanes, rows counted through all other axes."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        return builder.load(_pointer(context, builder, known, args), align=8)

    return lanes(array, row), made


def _put_lanes(_typing: Any, array: Any, row: Any, value: Any) -> Any:
    """Fill a row of an array whose last axis is the lanes."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        value = context.cast(builder, args[2], known.args[2], lanes)
        builder.store(value, _pointer(context, builder, known, args), align=8)
        return context.get_dummy_value()

    return types.void(array, row, value), made


def _where(_typing: Any, positive: Any, value: Any, other: Any) -> Any:
    """Return a value in the lanes in which a number is above 0, another in the others."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        number, value, other = map(context.cast, [builder] * 3, args, known.args, [lanes] * 3)
        return builder.select(builder.fcmp_ordered(">", number, ir.Constant(VECTOR, [0.0] * COUNT)), value, other)

    return lanes(positive, value, other), made


def _lent(_typing: Any, array: Any) -> Any:
    """Return an array whose users are not counted, which takes longer than using it; its owner must outlive them."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        struct = context.make_array(known.return_type)
        given, found = struct(context, builder, args[0]), struct(context, builder)
        for name in ("data", "shape", "strides", "itemsize", "nitems"):
            setattr(found, name, getattr(given, name))
        for name in ("meminfo", "parent"):
            setattr(found, name, tools.get_null_value(getattr(found, name).type))
        return found._getvalue()  # noqa: SLF001 - numba's way

    return array(array), made


# What compiled code calls.
lanes_of: Callable[[Any, int], Any] = extending.intrinsic(_lanes_of)
put_lanes: Callable[[Any, int, Any], None] = extending.intrinsic(_put_lanes)
where: Callable[[Any, Any, Any], Any] = extending.intrinsic(_where)
lent: Callable[[Any], Any] = extending.intrinsic(_lent)


def aligned(kind: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return records of zeros that begin where a register does."""
    room = np.zeros(kind.itemsize * count + ALIGNED_BYTES, np.uint8)
    first = -room.ctypes.data % ALIGNED_BYTES
    return room[first : first + kind.itemsize * count].view(kind)
