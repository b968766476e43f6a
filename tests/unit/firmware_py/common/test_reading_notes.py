import pytest

from firmware_py.common.reading_notes import Location, abbreviate, check_number


def test_notes_name_the_place_and_are_limited_to_50():
    location = Location("log", {})
    location.field("speed").note("not a number")
    for number in range(49):
        location.add(f"note {number}")
    assert len(location.notes) == 50
    location.add("note 3")  # known already
    assert len(location.notes) == 50
    location.add("one more")
    location.add("another")
    assert list(location.notes) == ["log.speed: not a number", *(f"note {n}" for n in range(49)), "and more"]


@pytest.mark.parametrize("number", [0, -3, 2.5, 1 << 1023, float("inf")])
def test_numbers_are_unchanged(number):
    assert check_number(number) == number


@pytest.mark.parametrize("data", [True, "1", None, (1 << 1023) + 1, [1.0]])
def test_other_data_are_no_numbers(data):
    with pytest.raises(ValueError, match="expected a number, found"):
        check_number(data)


def test_long_data_are_abbreviated_to_60_characters():
    assert abbreviate("x" * 58) == "'" + "x" * 58 + "'"
    assert abbreviate("x" * 59) == "'" + "x" * 56 + "..."
