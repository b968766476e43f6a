"""Text of earlier versions is brought up to date by rows."""

from dataclasses import dataclass

import pytest

from firmware_py.common.json_codec import Codec
from firmware_py.common.record_history import Change, bring_up_to_date


@dataclass(frozen=True, slots=True)
class HoldStation:
    centre_m: float
    radius_m: float = 0.0


@dataclass(frozen=True, slots=True)
class GoTo:
    place_m: float


@dataclass(frozen=True, slots=True)
class Estimate:
    heading_rad: float = 0.0
    bias_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Boat:
    task: HoldStation | GoTo | None = None
    queue: tuple[HoldStation | GoTo, ...] = ()
    estimate: Estimate = Estimate()
    faults: tuple[str, ...] = ()


def name_faults(record):
    record["faults"] = [("LATE", "LOST")[index] for index in record["faults"]]


CHANGES = (
    Change(
        2,
        moved=(("Keep.middle_m", "Keep.centre_m"), ("Ship.heading", "Ship.estimate.heading_rad"), ("Ship.old", None)),
        renamed={"Keep": "HoldStation", "Ship": "Boat"},
        converted={"Ship": name_faults},
    ),
    Change(3, moved=(("Boat.estimate.bias", "Boat.estimate.bias_rad"),), renamed={"Go": "GoTo"}),
)
CODEC = Codec((Boat,), changes=CHANGES)


def test_text_of_the_first_version_takes_every_step():
    text = (
        '{"$":"Ship","task":{"$":"Keep","middle_m":1.5},"queue":[{"$":"Go","place_m":2.0},{"$":"Keep","middle_m":3.0}],'
        '"heading":0.25,"old":7,"faults":[1,0]}'
    )
    boat = Boat(HoldStation(1.5), (GoTo(2.0), HoldStation(3.0)), Estimate(0.25), ("LOST", "LATE"))
    assert CODEC.read(text) == (boat, ())


def test_text_of_a_version_between_takes_the_later_steps_only():
    text = '{"version":2,"$":"Boat","task":{"$":"Go","place_m":2.0},"estimate":{"bias":0.5},"faults":["LATE"]}'
    assert CODEC.read(text) == (Boat(GoTo(2.0), (), Estimate(0.0, 0.5), ("LATE",)), ())


def test_text_of_today_is_left_as_it_is():
    boat = Boat(GoTo(1.0), (HoldStation(2.0, 3.0),), Estimate(0.1, 0.2), ("LATE",))
    text = CODEC.to_text(boat)
    assert text.startswith('{"version":3,')
    assert CODEC.read(text) == (boat, ())


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ('{"$":"Ship","heading":1.0,"estimate":null}', "Boat: field 'heading' is not known here, ignored"),
        ('{"$":"Ship","heading":1.0,"estimate":{"heading_rad":2.0}}', "Boat: field 'heading' is not known here"),
        ('{"$":"Ship","faults":[7]}', "Ship cannot be converted to version 2"),
        ('{"$":"Ship","faults":null}', "Ship cannot be converted to version 2"),
    ],
)
def test_what_cannot_be_moved_or_converted_is_reported(text, note):
    _, notes = CODEC.read(text)
    assert any(one.startswith(note) for one in notes)


def test_a_record_can_move_into_a_new_one_in_its_own_place():
    data = {"$": "Boat", "estimate": 1.5}
    bring_up_to_date(data, [Change(2, moved=(("Boat.estimate", "Boat.estimate.heading"),))], pytest.fail)
    assert data == {"$": "Boat", "estimate": {"heading": 1.5}}


def test_rows_that_cannot_be_meant_are_refused():
    with pytest.raises(ValueError, match="one class"):
        Change(2, moved=(("Boat.heading", "Ship.heading"),))
    with pytest.raises(ValueError, match="numbered"):
        Codec((Boat,), changes=(CHANGES[1], CHANGES[0]))
