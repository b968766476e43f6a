"""Numbers side by side, for compiled code: sixteen simulations in one vector, each with the bits that it has alone.

An equation that is written for a number is compiled for these lanes as well: the sum of two vectors is the sum of each
pair, and no order of operations changes. What is compared gives a mask, by which `where` chooses lane by lane.
hil/lab/lane_rows.py has where they stand in memory, hil/lab/lane_math.py the functions.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numba.extending
from llvmlite import ir
from numba.core import typeconv, types
from numba.core.datamodel import models as data_models
from numba.core.typing import templates

COUNT: Final = 16  # numbers of 64 bits, in two registers of 512: while one waits for a division the other goes on
VECTOR: Final = ir.VectorType(ir.DoubleType(), COUNT)
BITS: Final = ir.VectorType(ir.IntType(1), COUNT)
extending: Any = numba.extending  # numba's tools are untyped
typing: Any = templates
conversions: Any = typeconv
models: Any = data_models


class LanesType(types.Type):
    """The type of numbers side by side."""

    def __init__(self) -> None:
        """Be the one type of its kind."""
        super().__init__(name="Lanes")

    def can_convert_from(self, _typing: object, other: object) -> Any:
        """Let one number be the number of every lane."""
        return conversions.Conversion.safe if isinstance(other, types.Float | types.Integer) else None


class MaskType(types.Type):
    """The type of what is true in some lanes."""

    def __init__(self) -> None:
        """Be the one type of its kind."""
        super().__init__(name="Mask")

    def can_convert_from(self, _typing: object, other: object) -> Any:
        """Let what is true be true in every lane."""
        return conversions.Conversion.safe if isinstance(other, types.Boolean) else None


lanes: Any = LanesType()
mask: Any = MaskType()


@extending.register_model(LanesType)
class LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """A vector of the processor."""

    def __init__(self, manager: object, kind: object) -> None:
        """Take what numba hands to a model."""
        super().__init__(manager, kind, VECTOR)


@extending.register_model(MaskType)
class MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    """A vector of bits."""

    def __init__(self, manager: object, kind: object) -> None:
        """Take what numba hands to a model."""
        super().__init__(manager, kind, BITS)


def splat(builder: Any, vector: Any, value: Any) -> Any:
    """Return a vector of the same value in each lane."""
    nothing = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(nothing, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(ir.IntType(32), COUNT), [0] * COUNT))


def _from_number(context: Any, builder: Any, kind: Any, _to: Any, value: Any) -> Any:
    return splat(builder, VECTOR, context.cast(builder, value, kind, types.float64))


def _from_truth(_context: Any, builder: Any, _kind: Any, _to: Any, value: Any) -> Any:
    return splat(builder, BITS, builder.trunc(value, ir.IntType(1)) if value.type.width > 1 else value)


for _kind in (types.Float, types.Integer):
    extending.lower_cast(_kind, LanesType)(_from_number)
extending.lower_cast(types.Boolean, MaskType)(_from_truth)


def let(name: Callable[..., Any], made: Callable[..., Any], result: Any, *kinds: Any) -> None:
    """Let a function of Python have a meaning for lanes: that of some code, when one of its arguments is beside."""

    class Typing(typing.AbstractTemplate):  # type: ignore[misc]
        key = name

        def generic(self, args: Any, _named: Any) -> Any:
            beside = any(isinstance(arg, LanesType | MaskType) and arg in kinds for arg in args)
            return typing.signature(result, *kinds) if beside and len(args) == len(kinds) else None

    # With its type, and not as a decorator: numba looks for the module of a function, which numpy's have from 2.2 on.
    typing.infer_global(name, types.Function(Typing))
    extending.lower_builtin(name, *[type(kind) for kind in kinds])(
        lambda context, builder, _known, args: made(context, builder, *args)
    )


def _arithmetic(instruction: str) -> Callable[..., Any]:
    return lambda _context, builder, *args: getattr(builder, instruction)(*args)


def _comparison(sign: str, *, ordered: bool = True) -> Callable[..., Any]:
    def made(_context: Any, builder: Any, one: Any, other: Any) -> Any:
        return (builder.fcmp_ordered if ordered else builder.fcmp_unordered)(sign, one, other)

    return made


for _names, _instruction in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _name in _names:
        let(_name, _arithmetic(_instruction), lanes, lanes, lanes)
let(operator.neg, lambda _context, builder, arg: builder.fneg(arg), lanes, lanes)
for _name, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    let(_name, _comparison(_sign), mask, lanes, lanes)
let(operator.eq, _comparison("=="), mask, lanes, lanes)
let(operator.ne, _comparison("!=", ordered=False), mask, lanes, lanes)
let(operator.and_, lambda _context, builder, *args: builder.and_(*args), mask, mask, mask)
let(operator.or_, lambda _context, builder, *args: builder.or_(*args), mask, mask, mask)
let(operator.invert, lambda _context, builder, arg: builder.not_(arg), mask, mask)


def _where(_typing: Any, condition: Any, value: Any, other: Any) -> Any:
    """Return a value where a condition holds, or a number is above 0, another where not; both are computed."""
    beside = any(isinstance(arg, LanesType | MaskType) for arg in (condition, value, other))
    if beside:
        result = mask if all(isinstance(arg, MaskType | types.Boolean) for arg in (value, other)) else lanes
    else:
        whole = isinstance(value, types.Integer) and isinstance(other, types.Integer)
        truth = isinstance(value, types.Boolean) and isinstance(other, types.Boolean)
        result = types.boolean if truth else types.intp if whole else types.float64
    number = isinstance(condition, LanesType | types.Float)

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        value, other = (context.cast(builder, args[k], known.args[k], result) for k in (1, 2))
        wanted = (lanes if beside else types.float64) if number else (mask if beside else types.boolean)
        chosen = context.cast(builder, args[0], known.args[0], wanted)
        if number:
            chosen = builder.fcmp_ordered(">", chosen, ir.Constant(chosen.type, [0.0] * COUNT if beside else 0.0))
        return builder.select(chosen, value, other)

    return result(condition, value, other), made


def _any_of(_typing: Any, condition: Any) -> Any:
    """Whether a condition holds, or a number is above 0, in any lane."""

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        if not isinstance(condition, LanesType | MaskType):
            return args[0]
        held = args[0]
        if condition == lanes:
            held = builder.fcmp_ordered(">", held, ir.Constant(VECTOR, [0.0] * COUNT))
        bits = builder.bitcast(held, ir.IntType(COUNT))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(condition), made


def _bits_of(_typing: Any, condition: Any) -> Any:
    """Return the lanes in which a condition holds as bits of a number."""

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(COUNT)), ir.IntType(64))

    return types.intp(condition), made


def _mask_of(_typing: Any, bits: Any) -> Any:
    """Return the mask of the lanes whose bits are set in a number."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        number = context.cast(builder, args[0], known.args[0], types.intp)
        return builder.bitcast(builder.trunc(number, ir.IntType(COUNT)), BITS)

    return mask(bits), made


# What compiled code calls.
where: Callable[[Any, Any, Any], Any] = extending.intrinsic(_where)
any_of: Callable[[Any], bool] = extending.intrinsic(_any_of)
bits_of: Callable[[Any], int] = extending.intrinsic(_bits_of)
mask_of: Callable[[int], Any] = extending.intrinsic(_mask_of)
