"""Vectors of the processor, by which code is made as if they were numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from llvmlite import ir

from hil.lab.lanes import COUNT, VECTOR

WORD: Final = ir.IntType(64)
WORDS: Final = ir.VectorType(WORD, COUNT)
INDEX: Final = ir.IntType(32)
PAIR: Final = 2  # numbers of a table that stand beside each other, and are read at once


class Wide:
    """A vector of numbers, or of words, by which code is made as if it were one."""

    def __init__(self, builder: Any, value: Any) -> None:
        """Be a value of a builder."""
        self.builder, self.value = builder, value

    def _with(self, other: Wide | float) -> Any:
        if isinstance(other, Wide):
            return other.value
        return ir.Constant(self.value.type, [other] * COUNT)

    def filled(self, number: float) -> Wide:
        """Return the same number in each place."""
        return Wide(self.builder, self._with(number))

    def _made(self, instruction: str, other: Wide | float) -> Wide:
        return Wide(self.builder, getattr(self.builder, instruction)(self.value, self._with(other)))

    def called(self, name: str, *others: Wide | float) -> Wide:
        """Return what an instruction makes of numbers."""
        kind = ir.FunctionType(VECTOR, [VECTOR] * (1 + len(others)))
        function = self.builder.module.globals.get(full := f"llvm.{name}.v{COUNT}f64")
        function = function or ir.Function(self.builder.module, kind, full)
        return Wide(self.builder, self.builder.call(function, [self.value, *map(self._with, others)]))

    def __add__(self, other: Wide | float) -> Wide:
        """Return the sum."""
        return self._made("fadd", other)

    def __sub__(self, other: Wide | float) -> Wide:
        """Return the difference."""
        return self._made("fsub", other)

    def __rsub__(self, other: float) -> Wide:
        """Return a number less these."""
        return self.filled(other) - self

    def __mul__(self, other: Wide | float) -> Wide:
        """Return the product."""
        return self._made("fmul", other)

    def __truediv__(self, other: Wide | float) -> Wide:
        """Return the quotient."""
        return self._made("fdiv", other)

    def __neg__(self) -> Wide:
        """Return the number of the other sign."""
        return Wide(self.builder, self.builder.fneg(self.value))

    def __abs__(self) -> Wide:
        """Return the number without its sign."""
        return self.called("fabs")

    def fma(self, factor: Wide | float, more: Wide | float) -> Wide:
        """Return number times factor and more, rounded once."""
        return self.called("fma", factor, more)

    def polynomial(self, *coefficients: float) -> Wide:
        """Return a polynomial, from its highest power down, each step rounded once."""
        highest, *others = coefficients
        found = self.filled(highest)
        for coefficient in others:
            found = found.fma(self, coefficient)
        return found

    def signed_as(self, other: Wide) -> Wide:
        """Return the number with the sign of another."""
        return self.called("copysign", other)

    def below(self, other: float) -> Wide:
        """Return the mask of the numbers that are below another."""
        return Wide(self.builder, self.builder.fcmp_ordered("<", self.value, self._with(other)))

    def where(self, value: Wide, other: Wide) -> Wide:
        """Return, of a mask, a value where it holds and another where not."""
        return Wide(self.builder, self.builder.select(self.value, value.value, other.value))

    def words(self) -> Wide:
        """Return the words of numbers."""
        return Wide(self.builder, self.builder.bitcast(self.value, WORDS))

    def numbers(self) -> Wide:
        """Return the numbers of words."""
        return Wide(self.builder, self.builder.bitcast(self.value, VECTOR))

    def plus(self, other: Wide) -> Wide:
        """Return the sum of words."""
        return self._made("add", other)

    def masked(self, bits: int) -> Wide:
        """Return the bits of words that are in a mask."""
        return self._made("and_", bits)

    def shifted(self, places: int) -> Wide:
        """Return words shifted up."""
        return self._made("shl", places)

    def shifted_down(self, places: int) -> Wide:
        """Return words shifted down."""
        return self._made("lshr", places)

    def with_bits(self, bits: int) -> Wide:
        """Return words with the bits of a mask."""
        return self._made("or_", bits)

    def doubled(self) -> Wide:
        """Return words twice as large."""
        return self.shifted(1)

    def has(self, bit: int) -> Wide:
        """Return the mask of the words that have a bit."""
        return Wide(self.builder, self.builder.icmp_unsigned("!=", self.masked(bit).value, self._with(0)))

    def any(self) -> Any:
        """Return, of a mask, whether it holds anywhere."""
        bits = self.builder.bitcast(self.value, ir.IntType(COUNT))
        return self.builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    def pairs(self, table: Any, first: int = 0) -> tuple[Wide, Wide]:
        """Return the two numbers of a table that stand where words say, `first` further on."""
        build, zero = self.builder, ir.Constant(WORD, 0)
        two = ir.VectorType(ir.DoubleType(), PAIR)
        read = []
        for lane in range(COUNT):
            place = build.extract_element(self.value, ir.Constant(INDEX, lane))
            place = build.add(place, ir.Constant(WORD, first)) if first else place
            where = build.gep(table, [zero, place], inbounds=True)
            read.append(build.load(build.bitcast(where, two.as_pointer()), align=8, typ=two))
        joined, width = read, PAIR
        while len(joined) > 1:
            order = ir.Constant(ir.VectorType(INDEX, 2 * width), list(range(2 * width)))
            joined = [build.shuffle_vector(a, b, order) for a, b in zip(joined[::2], joined[1::2], strict=True)]
            width *= 2
        nothing = ir.Constant(joined[0].type, ir.Undefined)
        found = []
        for offset in range(PAIR):
            order = ir.Constant(ir.VectorType(INDEX, COUNT), list(range(offset, PAIR * COUNT, PAIR)))
            found.append(Wide(build, build.shuffle_vector(joined[0], nothing, order)))
        return found[0], found[1]


def table_of(module: Any, name: str, numbers: Sequence[float]) -> Any:
    """Return a table of numbers in a module."""
    if name in module.globals:
        return module.globals[name]
    kind = ir.ArrayType(ir.DoubleType(), len(numbers))
    table = ir.GlobalVariable(module, kind, name)
    table.initializer = ir.Constant(kind, [float(number) for number in numbers])
    table.global_constant, table.linkage, table.align = True, "internal", 64
    return table
