"""Quotients by one and the same divisor, rounded as a division rounds them, by its inverse, which is quicker.

Where a product and a sum are rounded once, a quotient that is next to the true one is corrected by what it leaves, and
then is the nearest (P. Markstein, IBM J. Res. Dev. 34(1), 1990). It is next to the true one when the inverse has
twice the digits (N. Brisebarre, J.-M. Muller, S. K. Raina, IEEE Trans. Comput. 53(8), 2004). Other processors divide.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import codegen
from numba.core import config as numba_config

from hil.lab.lanes import extending, lanes
from hil.lab.wide_numbers import Wide

config: Any = numba_config


def rounds_once() -> bool:
    """Whether the processor that code is made for rounds a product and a sum once."""
    features = config.CPU_FEATURES
    asked = codegen.get_host_cpu_features() if features is None else features  # type: ignore[no-untyped-call]
    return "+fma" in str(asked).split(",")


def _inverse_rest(_typing: Any, divisor: Any, inverse: Any) -> Any:
    """Return what an inverse is short of."""

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        if not rounds_once():
            return args[1]
        divisor, inverse = (Wide(builder, arg) for arg in args)
        return ((-divisor).fma(inverse, 1.0) * inverse).value

    return lanes(divisor, inverse), made


def _quotient(_typing: Any, number: Any, divisor: Any, inverse: Any, rest: Any) -> Any:
    """Return a number by a divisor above 0, of which the inverse and its rest are given; none of them near an end."""

    def made(_context: Any, builder: Any, _known: Any, args: Any) -> Any:
        number, divisor, inverse, rest = (Wide(builder, arg) for arg in args)
        if not rounds_once():
            return builder.fdiv(args[0], args[1])
        near = number.fma(inverse, number * rest)
        return (-near).fma(divisor, number).fma(inverse, near).signed_as(number).value

    return lanes(number, divisor, inverse, rest), made


# What compiled code calls.
inverse_rest: Callable[[Any, Any], Any] = extending.intrinsic(_inverse_rest)
quotient: Callable[[Any, Any, Any, Any], Any] = extending.intrinsic(_quotient)
