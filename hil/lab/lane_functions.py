"""exp, sin, cos, tanh and log1p of numbers side by side, with the bits of the C library.

glibc (2.28 and later) computes exp by a table of powers of two and a polynomial (S. Nagy, Optimized Routines), sine
and cosine by a table of both and polynomials (IBM Accurate Mathematical Library, without its slow paths), tanh by
what e to some power is more than 1, a quotient of polynomials, log1p by the powers of two in a number and a polynomial
(both Sun's fdlibm).
On a processor that rounds a product and a sum at once it does so, and so is done here, in the same places. The tables
are computed, to far more digits than they hold.

Numbers out of reach (huge ones) are left to the library, one by one. Whether the library of this machine computes the
same is for hil/lab/same_bits.py to see.
"""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from functools import cache
from struct import pack, unpack
from typing import Any, Final

from hil.lab.wide_numbers import Wide, table_of

Made = Callable[[Any, Any], Any]  # from a builder and a vector to a vector
number = float.fromhex

DIGITS: Final = 60
WHOLE: Final = number("0x1.8p52")  # added to a number, it leaves it without places after the point

# Powers of two from 1 to 2: how many, which bits count them, and where the exponent begins beside these.
POWERS, POWER_BITS, EXPONENT_FROM = 128, 127, 45
PER_LN2, LN2_HIGH, LN2_LOW = (
    number("0x1.71547652b82fep+7"), number("-0x1.62e42fefa0000p-8"), number("-0x1.cf79abc9e3b3ap-47"))  # fmt: skip
SQUARE, CUBE, FOURTH, FIFTH = (
    number("0x1.ffffffffffdbdp-2"), number("0x1.555555555543cp-3"),
    number("0x1.55555cf172b91p-5"), number("0x1.1111167a4d017p-7"))  # fmt: skip
EXP_REACH: Final = 512.0

ANGLES, ANGLE_BITS = 110, 127  # of the table, in steps of 1/128 rad
ANGLE: Final = number("0x1.8p45")  # added to a number, it leaves it in such steps
SMALL, PLAIN, HALF_TURN, ANGLE_REACH = 0.126, number("0x1.b6p-1"), number("0x1.368fdp+1"), 1e8
TAYLOR: Final = tuple(map(number, (
    "-0x1.addffc2fcdf59p-26", "0x1.71de27b9a7ed9p-19", "-0x1.a01a019db08b8p-13", "0x1.1111111110ecep-7",
    "-0x1.5555555555555p-3")))  # fmt: skip
SINE: Final = (number("0x1.11110e829872fp-7"), number("-0x1.5555555555515p-3"))
COSINE: Final = (number("0x1.6c16bedd9e239p-10"), number("-0x1.5555555555535p-5"), 0.5)
QUARTER, QUARTER_REST = number("0x1.921fb54442d18p+0"), number("0x1.1a62633145c07p-54")
PER_QUARTER: Final = number("0x1.45f306dc9c883p-1")
QUARTER_PARTS: Final = tuple(map(number, (
    "0x1.921fb58000000p+0", "-0x1.dde973c000000p-27", "-0x1.cb3b398000000p-55", "-0x1.d747f23e32ed7p-83")))  # fmt: skip

TANH_REACH: Final = 1.0
NO_LN2, ONE_LN2 = (
    number("0x1.62e43p-2"),
    number("0x1.0a2b2p+0"),
)  # below which a power is not brought nearer, and by one
LN2, LN2_REST = number("0x1.62e42feep-1"), number("0x1.a39ef35793c76p-33")
MORE: Final = tuple(map(number, (
    "-0x1.11111111110f4p-5", "0x1.a01a019fe5585p-10", "-0x1.4ce199eaadbb7p-14", "0x1.0cfca86e65239p-18",
    "-0x1.afdb76e09c32dp-23")))  # fmt: skip

# Of log1p: of a tiny number it is that number less half its square; of one to UNHALVED the series is of itself, beyond
# that of the distance to the nearest power of two, of which one is next to it; a number from ROOT on is nearer to two.
LOG1P_ABOVE, LOG1P_REACH = -0.29, 1e12
TINY, NEXT_BELOW, NEXT_ABOVE, ROOT = (
    number("0x1p-29"), number("-0x1.8p-20"), number("0x1p-20"), number("0x1.6a09ep+0"))  # fmt: skip
UNHALVED: Final = number("0x1.a827ap-2")
TWO_THIRDS: Final = number("0x1.5555555555555p-1")
LOGS: Final = tuple(map(number, (
    "0x1.5555555555593p-1", "0x1.999999997fa04p-2", "0x1.2492494229359p-2", "0x1.c71c51d8e78afp-3",
    "0x1.7466496cb03dep-3", "0x1.39a09d078c69fp-3", "0x1.2f112df3e5244p-3")))  # fmt: skip
NUMBER_BITS, EXPONENT_PLACES = (1 << 52) - 1, 52
ONE_BITS, COUNTED_BITS, COUNTED = 0x3FF << 52, 0x433 << 52, 2.0**52 + 1023.0


@cache
def powers() -> tuple[float, ...]:
    """Return what each power of two has beside the nearest number, and that number less the bits that count it."""
    with localcontext() as context:
        context.prec = DIGITS
        found: list[float] = []
        for k in range(POWERS):
            exact = (Decimal(2).ln() * k / POWERS).exp()
            near = float(exact)
            bits = unpack("<Q", pack("<d", near))[0] - (k << EXPONENT_FROM)
            found += (float((exact - Decimal(near)) / Decimal(near)), *unpack("<d", pack("<Q", bits)))
    return tuple(found)


@cache
def angles() -> tuple[float, ...]:
    """Return sine and cosine of each angle of the table, each as the nearest number and what is left."""
    with localcontext() as context:
        context.prec = DIGITS
        found: list[float] = []
        for k in range(ANGLE_BITS + 1):
            for exact in _sine_and_cosine(Decimal(min(k, ANGLES)) / (ANGLE_BITS + 1)):
                found += (float(exact), float(exact - Decimal(float(exact))))
    return tuple(found)


def _sine_and_cosine(angle_rad: Decimal) -> tuple[Decimal, Decimal]:
    sums, term = [Decimal(0), Decimal(1)], Decimal(1)
    for power in range(1, DIGITS):
        term = term * angle_rad / power
        sums[1 - power % 2] += -term if power % 4 > 1 else term
    return sums[0], sums[1]


def exp(builder: Any, given: Any) -> Any:
    """Return e to the power of numbers of which none is beyond EXP_REACH."""
    x = Wide(builder, given)
    counted = x.fma(PER_LN2, WHOLE)
    whole, words = counted - WHOLE, counted.words()
    rest = whole.fma(LN2_LOW, whole.fma(LN2_HIGH, x))
    more, power = words.masked(POWER_BITS).doubled().pairs(table_of(builder.module, "powers", powers()))
    scale = power.words().plus(words.shifted(EXPONENT_FROM)).numbers()
    square = rest * rest
    found = rest.polynomial(CUBE, SQUARE).fma(square, more + rest)
    found = (square * square).fma(rest.polynomial(FIFTH, FOURTH), found)
    return scale.fma(found, scale).value


class _Angle:
    """An angle within a quarter of a turn: a number and what is left, and what the table has near it."""

    def __init__(self, x: Wide, left: Wide | None) -> None:
        """Look the angle up."""
        table, size = table_of(x.builder.module, "angles", angles()), abs(x)
        counted = size + ANGLE
        place = counted.words().masked(ANGLE_BITS).doubled().doubled()
        self.x, self.left, self.rest = x, left, size - (counted - ANGLE)
        self.sine, self.sine_left = place.pairs(table)
        self.cosine, self.cosine_left = place.pairs(table, 2)

    def _left(self) -> Wide | None:
        """Return what is left of the angle without its sign."""
        return None if self.left is None else self.x.below(0.0).where(-self.left, self.left)

    def of_sine(self) -> Wide:
        """Return the sine."""
        rest, left, square = self.rest, self._left(), self.rest * self.rest
        cube, cosine = rest * square, square * square.polynomial(*COSINE)
        sine = rest + (cube * square.polynomial(*SINE) if left is None else cube.fma(square.polynomial(*SINE), left))
        cosine = cosine if left is None else rest.fma(left, cosine)
        more = (-cosine).fma(self.sine, sine.fma(self.cosine_left, self.sine_left))
        far = self.sine + sine.fma(self.cosine, more)
        return abs(self.x).below(SMALL).where(self._of_small(), far).signed_as(self.x)

    def _of_small(self) -> Wide:
        square = self.x * self.x
        found = square.polynomial(*TAYLOR)
        if self.left is None:
            return self.x + found * self.x * square
        return self.x + square.fma(found.fma(self.x, -(self.left * 0.5)), self.left)

    def of_cosine(self) -> Wide:
        """Return the cosine."""
        left = self._left()
        rest = self.rest if left is None else self.rest + left
        square = rest * rest
        sine, cosine = (rest * square).fma(square.polynomial(*SINE), rest), square * square.polynomial(*COSINE)
        more = (-cosine).fma(self.cosine, (-sine).fma(self.sine_left, self.cosine_left))
        return self.cosine + (-sine).fma(self.sine, more)


def small_sin(builder: Any, given: Any) -> Any:
    """Return the sine of angles of which none is as large as PLAIN."""
    return _Angle(Wide(builder, given), None).of_sine().value


def small_cos(builder: Any, given: Any) -> Any:
    """Return the cosine of angles of which none is as large as PLAIN."""
    return _Angle(Wide(builder, given), None).of_cosine().value


def sin(builder: Any, given: Any) -> Any:
    """Return the sine of angles of which none is beyond ANGLE_REACH."""
    x = Wide(builder, given)
    size, quarters, (near, left) = abs(x), *_within_a_quarter(x)
    plain, middle = size.below(PLAIN), size.below(HALF_TURN)
    angle = _Angle(
        plain.where(x, middle.where(QUARTER - size, near)),
        plain.where(x * 0.0, middle.where(x.filled(QUARTER_REST), left)),
    )
    sine, cosine = angle.of_sine(), angle.of_cosine()
    far = quarters.has(1).where(cosine, sine)
    far = quarters.has(2).where(-far, far)
    return plain.where(sine, middle.where(cosine.signed_as(x), far)).value


def cos(builder: Any, given: Any) -> Any:
    """Return the cosine of angles of which none is beyond ANGLE_REACH."""
    x = Wide(builder, given)
    size, quarters, (near, left) = abs(x), *_within_a_quarter(x)
    plain, middle = size.below(PLAIN), size.below(HALF_TURN)
    beyond = QUARTER - size
    short = beyond + QUARTER_REST
    angle = _Angle(
        plain.where(x, middle.where(short, near)),
        plain.where(x * 0.0, middle.where((beyond - short) + QUARTER_REST, left)),
    )
    sine, cosine = angle.of_sine(), angle.of_cosine()
    far = quarters.has(1).where(sine, cosine)
    far = quarters.plus(quarters.filled(1)).has(2).where(-far, far)
    return plain.where(cosine, middle.where(sine, far)).value


def _within_a_quarter(x: Wide) -> tuple[Wide, tuple[Wide, Wide]]:
    """Return how many quarters of a turn an angle has, as words, and what it has beside them, in two numbers."""
    counted = x.fma(PER_QUARTER, WHOLE)
    less = -(counted - WHOLE)
    first, second, third, fourth = QUARTER_PARTS
    rest = less.fma(second, less.fma(first, x))
    near = less.fma(third, rest)
    left = less.fma(third, rest - near)
    nearer = less.fma(fourth, near)
    return counted.words(), (nearer, left + less.fma(fourth, near - nearer))


def tanh(builder: Any, given: Any) -> Any:
    """Return the hyperbolic tangent of numbers of which none is as large as TANH_REACH."""
    x = Wide(builder, given)
    power = abs(x) * -2.0
    near, nearer = abs(power).below(NO_LN2), abs(power).below(ONE_LN2)
    far = (power * (PER_LN2 / POWERS) - 0.5).called("trunc")
    times = near.where(x * 0.0, nearer.where(x.filled(-1.0), far))
    high, low = (-times).fma(LN2, power), times * LN2_REST
    rest = high - low
    left = (high - rest) - low
    half = rest * 0.5
    square = rest * half
    more = _quotient_more(rest, half, square)
    shifted = (more - left).fma(rest, -left) - square
    some = nearer.where((rest - shifted).fma(0.5, -0.5), (1.0 - (shifted - rest)) * _scale(far) - 1.0)
    found = near.where(rest - more.fma(rest, -square), some)
    return (-found / (found + 2.0)).signed_as(x).value


def _scale(times: Wide) -> Wide:
    """Return two to a power that is -2 or -3."""
    return times.below(-2.5).where(times.filled(0.125), times.filled(0.25))


def _quotient_more(rest: Wide, half: Wide, square: Wide) -> Wide:
    """Return what of e to a power is beyond its first terms."""
    first, second, third, fourth, fifth = MORE
    twice = square * square
    found = twice.fma(square.polynomial(third, second), square.polynomial(first, 1.0))
    found = (twice * twice).fma(square.polynomial(fifth, fourth), found)
    three = (-half).fma(found, 3.0)
    return (found - three) / (-rest).fma(three, 6.0) * square


def log1p(builder: Any, given: Any) -> Any:
    """Return the logarithm of 1 and more, of numbers between LOG1P_ABOVE and LOG1P_REACH."""
    x = Wide(builder, given)
    whole = x + 1.0
    mantissa = whole.words().masked(NUMBER_BITS).with_bits(ONE_BITS).numbers()
    times = whole.words().shifted_down(EXPONENT_PLACES).with_bits(COUNTED_BITS).numbers() - COUNTED
    lost = times.below(1.0).where(x - (whole - 1.0), 1.0 - (whole - x)) / whole
    low, small = mantissa.below(ROOT), x.below(UNHALVED)
    times = small.where(x * 0.0, low.where(times, times + 1.0))
    rest = small.where(x, low.where(mantissa, mantissa * 0.5) - 1.0)
    half = rest * 0.5 * rest
    part = rest / (rest + 2.0)
    series, more = part * (_log_more(part * part) + half), times.fma(LN2_REST, lost)
    found = times.fma(LN2, -((half - (more + series)) - rest))
    next_to = half * (-rest).fma(TWO_THIRDS, 1.0)
    nearest = times.fma(LN2, -((next_to - more) - rest))
    found = rest.below(NEXT_BELOW).where(found, rest.below(NEXT_ABOVE).where(nearest, found))
    return abs(x).below(TINY).where((x * x).fma(-0.5, x), small.where(x - (half - series), found)).value


def _log_more(square: Wide) -> Wide:
    """Return what of a logarithm is beyond its first terms."""
    first, second, third, fourth, fifth, sixth, seventh = LOGS
    twice = square * square
    four_times = twice * twice
    found = square.fma(first, twice * square.fma(third, second))
    found = four_times.fma(square.fma(fifth, fourth), found)
    return (twice * four_times).fma(square.fma(seventh, sixth), found)
