import json
import math
import re
from dataclasses import dataclass, replace
from enum import IntEnum

import pytest

from firmware_py.common.intents import Arm, ManualRudder, Request, SetMode, SetParameter, SteerHeading, SteerPosition
from firmware_py.common.json_codec import Codec, Hook
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.reading_notes import MOST_NOTES


class Colour(IntEnum):
    RED = 1
    GREEN = 2


@dataclass(frozen=True, slots=True)
class Circle:
    radius_m: float


@dataclass(frozen=True, slots=True)
class Square:
    side_m: float
    name: str = ""


@dataclass(frozen=True, slots=True)
class Branch:
    left: "Branch | None" = None


@dataclass(frozen=True, slots=True)
class Whole:
    number: float
    count: int
    on: bool
    text: str
    colour: Colour
    shape: Circle | Square | None
    many: tuple[Circle, ...]
    pair: tuple[int, float]
    either: int | str | None
    values: ParameterSet
    branch: Branch | None = None


@dataclass(frozen=True, slots=True)
class Strange:
    items: list[int]


def parameters_from(data, _spot):
    if not isinstance(data, list):
        raise ValueError("expected the values")  # noqa: TRY004 -- as hooks must
    return ParameterSet(data)


HOOK = Hook(ParameterSet, lambda values: list(values.values()), parameters_from)
CODEC = Codec((Whole, Circle), (HOOK,))
WHOLE = Whole(
    0.1,
    -3,
    True,
    'quote " and é and \ud800',
    Colour.GREEN,
    Square(2.5, "sea"),
    (Circle(1.0), Circle(-0.0)),
    (7, 1e-320),
    "x",
    ParameterSet().replaced("CTL_K1", 12.5),
    Branch(Branch(None)),
)


def round_trip(record, codec=CODEC):
    back, notes = codec.read(codec.to_text(record))
    assert notes == ()
    return back


def test_a_record_of_everything_comes_back_the_same():
    assert round_trip(WHOLE) == WHOLE
    assert repr(round_trip(WHOLE).many) == repr(WHOLE.many)  # the sign of zero too
    assert type(round_trip(WHOLE).colour) is Colour


def test_text_is_one_line_of_ascii():
    text = CODEC.to_text(WHOLE)
    assert text.isascii()
    assert "\n" not in text


@pytest.mark.parametrize("number", [math.inf, -math.inf, 5e-324, 1.7976931348623157e308, 0.1 + 0.2, 3])
def test_numbers_keep_their_bits_and_their_kind(number):
    back = round_trip(Circle(number)).radius_m
    assert repr(back) == repr(number)


def test_nan_is_carried():
    assert math.isnan(round_trip(Circle(math.nan)).radius_m)


@pytest.mark.parametrize("shape", [None, Circle(1.5), Square(1.5)])
def test_a_union_keeps_the_class(shape):
    assert round_trip(replace(WHOLE, shape=shape)).shape == shape


@pytest.mark.parametrize(
    "intent",
    [
        SetMode(Mode.GUIDED.value),
        Arm(True, force=True),
        SteerHeading(1.25, relative=True, over_ground=True, turn=-1, change_mode=True),
        SteerPosition(0.7, -1.1, change_mode=True),
        ManualRudder(None),
        ManualRudder(-0.25),
        SetParameter("CTL_K1", math.nan),
    ],
)
def test_every_intent_is_carried(intent):
    request = Request(1.5, intent, 255, 190)
    assert repr(round_trip(request, Codec((Request,)))) == repr(request)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "Expecting value"),
        ("{", "Expecting"),
        ("[1]", "expected one of Whole, Circle"),
        ('{"$":"Square","side_m":1.0,"name":""}', "expected one of Whole, Circle"),
        ('{"$":["Circle"],"radius_m":1.0}', "expected one of"),
        ('{"$":"Circle"}', "Circle: field 'radius_m' is missing"),
        ('{"$":"Circle","radius_m":"1"}', "Circle.radius_m: expected a number, found '1'"),
        ('{"$":"Circle","radius_m":true}', "Circle.radius_m: expected a number, found True"),
        ('{"$":"Circle","radius_m":null}', "Circle.radius_m: expected a number, found None"),
        ('{"$":"Circle","radius_m":' + "9" * 400 + "}", "Circle.radius_m: expected a number, found 999"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_text_that_is_not_a_record_is_refused(text, says):
    with pytest.raises(ValueError, match=re.escape(says)):
        CODEC.read(text)


@pytest.mark.parametrize(
    ("field", "written", "instead", "says"),
    [
        ("count", '"count":-3', '"count":1.0', "Whole.count: expected a whole number"),
        ("on", '"on":true', '"on":1', "Whole.on: expected true or false"),
        ("colour", '"colour":2', '"colour":9', "Whole.colour: expected a number of Colour, found 9"),
        ("colour", '"colour":2', '"colour":2.0', "Whole.colour: expected a number of Colour"),
        ("pair", "[7,", "[7,7,", "Whole.pair: expected 2 items, found 3"),
        ("many", '"many":[', '"many":[4,', "Whole.many: expected Circle, found 4"),
        ("values", '"values":[', '"values":[1,', "Whole.values"),
    ],
)
def test_a_wrong_field_is_named(field, written, instead, says):
    text = CODEC.to_text(WHOLE)
    assert written in text
    with pytest.raises(ValueError, match=f"Whole.{field}") as refusal:
        CODEC.read(text.replace(written, instead))
    assert says in str(refusal.value)


@pytest.mark.parametrize(
    ("written", "instead", "change", "says"),
    [
        ('"side_m":2.5', '"side_m":[]', {"shape": None}, "Whole.shape.side_m: expected a number, found []"),
        ('"$":"Square"', '"$":"Oval"', {"shape": None}, "Whole.shape: expected one of Circle, Square, NoneType"),
        ('"either":"x"', '"either":[]', {"either": None}, "Whole.either: expected one of int, str, NoneType"),
        ('"name":"sea"', '"name":7', {"shape": Square(2.5)}, "Whole.shape.name: expected a text, found 7"),
        ('"left":null', '"left":3', {"branch": Branch(Branch())}, "Whole.branch.left.left: expected one of Branch"),
        ('"version":1,', '"version":9,', {}, "written by a later version (9, here 1), read by name"),
        ('"version":1,', '"version":[],', {}, "the version is no number, read as version 1"),
        ('"name":"sea",', '"name":"sea","depth_m":2,', {}, "Whole.shape: field 'depth_m' is not known here, ignored"),
    ],
)
def test_what_can_be_done_without_is_reported(written, instead, change, says):
    text = CODEC.to_text(WHOLE)
    assert text.count(written) == 1
    back, notes = CODEC.read(text.replace(written, instead))
    assert back == replace(WHOLE, **change)
    assert len(notes) == 1
    assert notes[0].startswith(says)


def test_missing_fields_take_their_defaults_and_tags_decide_in_unions_alone():
    text = CODEC.to_text(WHOLE)
    for written in (',"name":"sea"', '"branch":{"left":{"left":null,"$":"Branch"},"$":"Branch"},'):
        assert written in text
        text = text.replace(written, "")
    assert CODEC.read(text) == (replace(WHOLE, shape=Square(2.5), branch=None), ())
    branch = '{"$":"Branch","left":{"left":null,"$":"Twig"}}'
    assert Codec((Branch,)).read(branch) == (Branch(Branch()), ())


def test_notes_are_said_once_and_have_an_end():
    text = json.dumps({"$": "Circle", "radius_m": 1.0} | {f"x{number}": 1 for number in range(1000)})
    _, notes = Codec((Circle,)).read(text)
    assert len(notes) == len(set(notes)) == MOST_NOTES + 1
    twice = CODEC.to_text(replace(WHOLE, many=(Circle(1.0), Circle(1.0)))).replace('"radius_m"', '"x":1,"radius_m"')
    assert CODEC.read(twice)[1] == ("Whole.many: field 'x' is not known here, ignored",)


def test_what_cannot_be_carried_is_a_type_error():
    with pytest.raises(TypeError, match="list"):
        Codec((Strange,))
    with pytest.raises(TypeError, match="ParameterSet"):
        Codec((Whole,))
    with pytest.raises(TypeError, match="Square"):
        Codec((Circle,)).to_text(Square(1.0))


def test_a_hook_refuses_with_its_own_words():
    with pytest.raises(ParameterError):
        HOOK.decode([1.0], None)
    text = CODEC.to_text(WHOLE)
    start = text.index('"values":') + len('"values":')
    broken = text[:start] + "3" + text[text.index("]", start) + 1 :]
    with pytest.raises(ValueError, match=r"Whole\.values: expected the values"):
        CODEC.read(broken)
