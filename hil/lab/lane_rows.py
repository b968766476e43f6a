"""Where numbers side by side stand in memory: rows of arrays whose last axis is the lanes, and fields of records."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numpy.typing import NDArray

from hil.lab.lanes import BITS, COUNT, VECTOR, LanesType, extending, lanes, mask, models, typing

ALIGNED_BYTES: Final = 64
AHEAD: Final = 24  # numbers that are asked for early: of some ticks
tools: Any = cgutils
kinds: Any = types


class RowsType(types.Type):
    """The type of the rows of an array whose last axis is the lanes, of which those of a mask are filled."""

    def __init__(self) -> None:
        """Be the one type of its kind."""
        super().__init__(name="Rows")


class FieldsType(types.Type):
    """The type of a record each field of which is a number of each lane."""

    def __init__(self, record: Any) -> None:
        """Be of a type of records."""
        self.record = record
        super().__init__(name=f"Fields({record})")


rows_type: Any = RowsType()


@extending.register_model(RowsType)
class RowsModel(models.StructModel):  # type: ignore[misc]
    """Where the rows begin, and the lanes that are filled."""

    def __init__(self, manager: object, kind: object) -> None:
        """Take what numba hands to a model."""
        super().__init__(manager, kind, [("data", kinds.CPointer(kinds.float64)), ("on", mask)])


@extending.register_model(FieldsType)
class FieldsModel(models.PrimitiveModel):  # type: ignore[misc]
    """Where the record begins."""

    def __init__(self, manager: object, kind: object) -> None:
        """Take what numba hands to a model."""
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


def _pointer(builder: Any, data: Any, row: Any) -> Any:
    return builder.bitcast(builder.gep(data, [builder.mul(row, ir.Constant(row.type, COUNT))]), VECTOR.as_pointer())


def _row_of(context: Any, builder: Any, known: Any, args: Any) -> Any:
    row = context.cast(builder, args[1], known.args[1], types.intp)
    return _pointer(builder, context.make_array(known.args[0])(context, builder, args[0]).data, row)


def _lanes_of(_typing: Any, array: Any, row: Any) -> Any:
    """Return a row of an array whose last axis is the lanes, rows counted through all other axes."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        return builder.load(_row_of(context, builder, known, args), align=8)

    return lanes(array, row), made


def _put_lanes(_typing: Any, array: Any, row: Any, value: Any) -> Any:
    """Fill a row of an array whose last axis is the lanes."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        value = context.cast(builder, args[2], known.args[2], lanes)
        builder.store(value, _row_of(context, builder, known, args), align=8)
        return context.get_dummy_value()

    return types.void(array, row, value), made


def _rows(_typing: Any, array: Any, on: Any) -> Any:
    """Return the rows of an array whose last axis is the lanes: read as lanes, filled in the lanes of a mask."""

    def made(context: Any, builder: Any, known: Any, args: Any) -> Any:
        found = tools.create_struct_proxy(rows_type)(context, builder)
        found.data = builder.bitcast(
            context.make_array(known.args[0])(context, builder, args[0]).data, ir.DoubleType().as_pointer()
        )
        found.on = context.cast(builder, args[1], known.args[1], mask)
        return found._getvalue()  # noqa: SLF001 - numba's way

    return rows_type(array, on), made


def _fields(_typing: Any, record: Any) -> Any:
    """Return a record of which each field is read as lanes."""

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        return builder.bitcast(args[0], ir.IntType(8).as_pointer())

    return FieldsType(record)(record), made


@typing.infer_getattr
class FieldsAttribute(typing.AttributeTemplate):  # type: ignore[misc]
    """What is read of a record side by side."""

    key = FieldsType

    def generic_resolve(self, kind: Any, name: str) -> Any:
        """Say that a field is lanes, or rows of them."""
        if name not in kind.record.fields:
            return None
        return lanes if kind.record.typeof(name).ndim == 1 else rows_type


def _field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
    place = builder.gep(value, [ir.Constant(ir.IntType(64), kind.record.offset(name))], source_etype=ir.IntType(8))
    if kind.record.typeof(name).ndim == 1:
        return builder.load(builder.bitcast(place, VECTOR.as_pointer()), align=8, typ=VECTOR)
    found = tools.create_struct_proxy(rows_type)(context, builder)
    found.data = builder.bitcast(place, ir.DoubleType().as_pointer())
    found.on = ir.Constant(BITS, [1] * COUNT)
    return found._getvalue()  # noqa: SLF001 - numba's way


extending.lower_getattr_generic(FieldsType)(_field)


@typing.infer_global(operator.getitem)
class _Read(typing.AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, _named: Any) -> Any:
        if args[0] == rows_type and isinstance(args[1], types.Integer):
            return typing.signature(lanes, rows_type, types.intp)
        if isinstance(args[0], types.Array) and args[0].ndim == 1 and args[1] == lanes:
            return typing.signature(lanes, *args)
        return None


@typing.infer_global(operator.setitem)
class _Fill(typing.AbstractTemplate):  # type: ignore[misc]
    def generic(self, args: Any, _named: Any) -> Any:
        fits = args[0] == rows_type and isinstance(args[1], types.Integer)
        return typing.signature(types.void, rows_type, types.intp, lanes) if fits else None


def _read(context: Any, builder: Any, _known: Any, args: Any) -> Any:
    given = tools.create_struct_proxy(rows_type)(context, builder, args[0])
    return builder.load(_pointer(builder, given.data, args[1]), align=8, typ=VECTOR)


extending.lower_builtin(operator.getitem, RowsType, types.Integer)(_read)


def _fill(context: Any, builder: Any, _known: Any, args: Any) -> Any:
    given = tools.create_struct_proxy(rows_type)(context, builder, args[0])
    place = _pointer(builder, given.data, args[1])
    before = builder.load(place, align=8, typ=VECTOR)
    builder.store(builder.select(given.on, args[2], before), place, align=8)
    return context.get_dummy_value()


extending.lower_builtin(operator.setitem, RowsType, types.Integer, LanesType)(_fill)


def _gather(context: Any, builder: Any, known: Any, args: Any) -> Any:
    """Read a number for each lane; an index is a whole number, and is in the array in every lane."""
    data = context.make_array(known.args[0])(context, builder, args[0]).data
    places = builder.fptosi(args[1], ir.VectorType(ir.IntType(64), COUNT))
    found = ir.Constant(VECTOR, ir.Undefined)
    for lane in range(COUNT):
        number = ir.Constant(ir.IntType(32), lane)
        place = builder.gep(data, [builder.extract_element(places, number)])
        found = builder.insert_element(found, builder.load(place), number)
        _ask_ahead(builder, place)
    return found


def _ask_ahead(builder: Any, place: Any) -> None:
    """Ask the memory for what stands a little further on, which is read next: so many series a processor forgets."""
    byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
    kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
    prefetch = tools.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
    ahead = builder.bitcast(builder.gep(place, [ir.Constant(ir.IntType(64), AHEAD)]), byte)
    builder.call(prefetch, [ahead, *(ir.Constant(whole, value) for value in (0, 3, 1))])  # to read, to be kept, data


extending.lower_builtin(operator.getitem, types.Array, LanesType)(_gather)


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
rows: Callable[[Any, Any], Any] = extending.intrinsic(_rows)
fields: Callable[[Any], Any] = extending.intrinsic(_fields)
lent: Callable[[Any], Any] = extending.intrinsic(_lent)


def aligned(kind: np.dtype[Any], count: int) -> NDArray[Any]:
    """Return records of zeros that begin where a register does."""
    room = np.zeros(kind.itemsize * count + ALIGNED_BYTES, np.uint8)
    first = -room.ctypes.data % ALIGNED_BYTES
    return room[first : first + kind.itemsize * count].view(kind)
