"""Option records: values of a file, defaults, and messages for invalid values."""

import math
from dataclasses import dataclass

import pytest

from firmware_py.common.options import OptionMeaning, check, meanings, option, record_from


@dataclass(frozen=True, slots=True)
class Lamp:
    socket: str = option("mounting point")
    power_w: float = option("power", default=5.0, minimum=0.5, maximum=60.0)
    number: int = option("number", default=1, minimum=1, maximum=9)
    dimmed: bool = option("dimmed", default=False)
    colours: tuple[str, ...] = option("colours", default=(), choices=("red", "green"))
    height_m: float | None = option("height", default=None, minimum=0.0, maximum=30.0)
    mode: str = option("mode", default="fixed", choices=("fixed", "blinking"))

    def __post_init__(self):
        check(self)


def test_missing_options_have_their_defaults():
    assert record_from(Lamp, {"socket": "mast"}) == Lamp("mast", 5.0, 1, False, (), None, "fixed")


def test_values_are_converted_to_the_types_of_the_record():
    values = {"socket": "bow", "power_w": 6, "number": 2.0, "dimmed": True, "colours": ["red"], "height_m": 3}
    lamp = record_from(Lamp, values | {"mode": "blinking"})
    assert lamp == Lamp("bow", 6.0, 2, True, ("red",), 3.0, "blinking")
    assert (type(lamp.power_w), type(lamp.number)) == (float, int)


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({}, "socket is missing"),
        ({"socket": 5}, "socket: expected a text in quotes"),
        ({"socket": ""}, "socket: expected a text in quotes"),
        ({"socket": "x", "power_w": "much"}, "power_w: expected a number from 0.5 to 60"),
        ({"socket": "x", "power_w": True}, "power_w: expected a number from 0.5 to 60"),
        ({"socket": "x", "power_w": math.nan}, "power_w: expected a number from 0.5 to 60"),
        ({"socket": "x", "power_w": 0.4}, "power_w: 0.4 is out of range; allowed: 0.5 to 60"),
        ({"socket": "x", "number": 1.5}, "number: 1.5 is not a whole number"),
        ({"socket": "x", "number": 10}, "number: 10 is out of range; allowed: 1 to 9"),
        ({"socket": "x", "number": 10**400}, "number: expected a number from 1 to 9"),
        ({"socket": "x", "dimmed": 1}, "dimmed: expected true or false"),
        ({"socket": "x", "colours": "red"}, "colours: expected a list of texts"),
        ({"socket": "x", "colours": ["red", ""]}, "colours: expected a list of texts"),
        ({"socket": "x", "colours": ["red", 5]}, "colours: expected a list of texts"),
        ({"socket": "x", "colours": ["red", "blue"]}, "colours: 'blue' is not known; use one of red, green"),
        ({"socket": "x", "height_m": 31}, "height_m: 31 is out of range; allowed: 0 to 30"),
        ({"socket": "x", "mode": "off"}, "mode: 'off' is not known; use one of fixed, blinking"),
    ],
)
def test_error_of_an_invalid_option_names_it(values, problem):
    with pytest.raises(ValueError) as error_info:
        record_from(Lamp, values)
    assert problem in str(error_info.value)


@pytest.mark.parametrize(("name", "low", "high"), [("power_w", 0.5, 60.0), ("number", 1, 9), ("height_m", 0.0, 30.0)])
def test_limits_of_an_option_are_allowed(name, low, high):
    for value in (low, high):
        assert getattr(record_from(Lamp, {"socket": "x", name: value}), name) == value
    for value in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"{name}: {value:g} is out of range"):
            record_from(Lamp, {"socket": "x", name: value})


@dataclass(frozen=True, slots=True)
class Undeclared:
    height_m: float = 1.0


@dataclass(frozen=True, slots=True)
class Unsupported:
    sizes: bytes = option("sizes", default=None)


@pytest.mark.parametrize(("kind", "name"), [(Undeclared, "height_m"), (Unsupported, "sizes")])
def test_record_with_a_field_that_cannot_be_read_is_refused_before_it_has_a_value(kind, name):
    with pytest.raises(TypeError, match=rf"{name}: not declared by option\(\), or of a type that is not supported"):
        record_from(kind, {})


def test_any_error_of_a_record_is_a_refusal_of_its_values():
    @dataclass(frozen=True, slots=True)
    class Hasty:
        number: int = option("number", default=1, minimum=0, maximum=9)

        def __post_init__(self):
            if self.number == 2:
                raise ValueError("2 is taken")
            {1: 2}[self.number]

    assert record_from(Hasty, {"number": 1}) == Hasty(1)
    with pytest.raises(ValueError, match=r"^number: 10 is out of range; allowed: 0 to 9$"):
        record_from(Hasty, {"number": 10})
    with pytest.raises(ValueError, match=r"^2 is taken$"):
        record_from(Hasty, {"number": 2})
    with pytest.raises(ValueError, match=r"^options refused by the driver: KeyError: 3$"):
        record_from(Hasty, {"number": 3})


def test_record_created_without_a_file_is_checked():
    with pytest.raises(ValueError, match=r"number: 2\.5 is not a whole number"):
        Lamp("x", number=2.5)


def test_meanings_have_description_and_range():
    assert list(meanings(Lamp)) == ["socket", "power_w", "number", "dimmed", "colours", "height_m", "mode"]
    assert meanings(Lamp)["power_w"] == OptionMeaning("power", 0.5, 60.0)
