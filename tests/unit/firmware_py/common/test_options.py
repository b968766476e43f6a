"""Records of options: what a file may hold, and what is said of what it may not."""

import math
from dataclasses import dataclass

import pytest

from firmware_py.common.options import OptionMeaning, check, meanings, option, record_from


@dataclass(frozen=True, slots=True)
class Lamp:
    socket: str = option("where it hangs")
    power_w: float = option("what it draws", default=5.0, minimum=0.5, maximum=60.0)
    number: int = option("which it is", default=1, minimum=1, maximum=9)
    dimmed: bool = option("whether it is dimmed", default=False)
    colours: tuple[str, ...] = option("what it shines in", default=(), choices=("red", "green"))
    height_m: float | None = option("how high it hangs", default=None, minimum=0.0, maximum=30.0)

    def __post_init__(self):
        check(self)


def test_missing_options_take_their_defaults():
    assert record_from(Lamp, {"socket": "mast"}) == Lamp("mast", 5.0, 1, False, (), None)


def test_values_of_a_file_are_read_by_the_types_of_the_record():
    values = {"socket": "bow", "power_w": 6, "number": 2.0, "dimmed": True, "colours": ["red"], "height_m": 3}
    lamp = record_from(Lamp, values)
    assert lamp == Lamp("bow", 6.0, 2, True, ("red",), 3.0)
    assert (type(lamp.power_w), type(lamp.number)) == (float, int)


@pytest.mark.parametrize(
    ("values", "complaint"),
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
        ({"socket": "x", "colours": ["red", "blue"]}, "colours: 'blue' is not known; use one of red, green"),
        ({"socket": "x", "height_m": 31}, "height_m: 31 is out of range; allowed: 0 to 30"),
    ],
)
def test_invalid_options_are_refused_by_name(values, complaint):
    with pytest.raises(ValueError) as caught:
        record_from(Lamp, values)
    assert complaint in str(caught.value)


def test_a_record_made_without_a_file_is_checked_too():
    with pytest.raises(ValueError, match=r"number: 2\.5 is not a whole number"):
        Lamp("x", number=2.5)


def test_every_option_has_a_description_and_a_range():
    assert list(meanings(Lamp)) == ["socket", "power_w", "number", "dimmed", "colours", "height_m"]
    assert meanings(Lamp)["power_w"] == OptionMeaning("what it draws", 0.5, 60.0)
