import copy
import dataclasses
import inspect
import pickle

import pytest

from firmware_py.common import record_class


def of(dataclass):
    """The same records by another decorator."""

    @dataclass(frozen=True, slots=True)
    class Point:
        x: float
        y: float = 2.0
        items: list = dataclasses.field(default_factory=list)

        @property
        def both(self):
            return self.x, self.y

    @dataclass(frozen=True, slots=True)
    class One:
        value: object = None

    @dataclass(frozen=True, slots=True)
    class Nothing:
        pass

    @dataclass(frozen=True, slots=True)
    class Checked:
        value: int

        def __post_init__(self):
            if self.value < 0:
                raise ValueError("below 0")

    return Point, One, Nothing, Checked


OURS, THEIRS = of(record_class.dataclass), of(dataclasses.dataclass)


@record_class.dataclass(frozen=True, slots=True)
class Kept:
    x: float
    name: str = "a"


@pytest.mark.parametrize(
    ("which", "words", "more"),
    [
        (0, (1.0,), {}),
        (0, (1.0, 3.0), {"items": [1]}),
        (0, (), {"y": 1, "x": 2}),
        (1, (), {}),
        (1, ((),), {}),
        (2, (), {}),
    ],
)
def test_a_record_is_what_the_standard_library_makes(which, words, more):
    ours, theirs = OURS[which](*words, **more), THEIRS[which](*words, **more)
    assert repr(ours) == repr(theirs)
    assert dataclasses.asdict(ours) == dataclasses.asdict(theirs)
    assert [field.name for field in dataclasses.fields(ours)] == [field.name for field in dataclasses.fields(theirs)]
    assert ours == OURS[which](*words, **more)
    assert ours != theirs
    assert ours.__slots__ == theirs.__slots__
    assert ours.__match_args__ == theirs.__match_args__
    assert str(inspect.signature(type(ours))).count(",") == str(inspect.signature(type(theirs))).count(",")
    assert dataclasses.replace(ours) == ours
    if which:
        assert hash(ours) == hash(theirs) == hash(OURS[which](*words, **more))
    assert copy.copy(ours) == copy.deepcopy(ours) == ours


def test_defaults_that_are_made_are_made_anew_each_time():
    assert OURS[0](1.0).items is not OURS[0](1.0).items
    assert OURS[0](1.0, 5.0).both == (1.0, 5.0)


def test_it_cannot_be_changed():
    record = Kept(1.0)
    with pytest.raises(dataclasses.FrozenInstanceError, match="assign to field 'x'"):
        record.x = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError, match="delete field 'x'"):
        del record.x
    with pytest.raises(dataclasses.FrozenInstanceError):
        record.other = 2.0


def test_it_can_be_pickled():
    record = Kept(1.0, "b")
    assert pickle.loads(pickle.dumps(record)) == record


@pytest.mark.parametrize(("words", "more"), [((), {}), ((1.0, 2.0, [], 4.0), {}), ((1.0,), {"z": 1})])
def test_a_wrong_call_is_a_type_error(words, more):
    with pytest.raises(TypeError, match="__init__"):
        OURS[0](*words, **more)


def test_a_record_checks_itself():
    assert OURS[3](1).value == 1
    with pytest.raises(ValueError, match="below 0"):
        OURS[3](-1)


def test_a_first_call_that_is_wrong_leaves_the_class_as_sound_as_before():
    _, one, nothing, checked = of(record_class.dataclass)
    with pytest.raises(TypeError, match="__init__"):
        one(1, 2)
    with pytest.raises(ValueError, match="below 0"):
        checked(-1)
    assert (one(3).value, checked(4).value, repr(nothing()).endswith("Nothing()")) == (3, 4, True)


@pytest.mark.parametrize(
    ("which", "words", "more"), [(0, (1.0,), {}), (0, (), {"y": 1, "x": 2}), (1, ((),), {}), (2, (), {}), (3, (1,), {})]
)
def test_a_maker_makes_what_the_class_makes(which, words, more):
    kind = OURS[which]
    made = record_class.maker(kind)(*words, **more)
    assert made == kind(*words, **more)
    assert made.__class__ is kind
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.x = 2.0
    if which == 0:
        assert made.items is not record_class.maker(kind)(*words, **more).items


def test_a_maker_has_a_record_check_itself():
    with pytest.raises(ValueError, match="below 0"):
        record_class.maker(OURS[3])(-1)


@pytest.mark.parametrize(("words", "more"), [((), {}), ((1.0, 2.0, [], 4.0), {}), ((1.0,), {"z": 1})])
def test_a_wrong_call_of_a_maker_is_a_type_error(words, more):
    with pytest.raises(TypeError, match="make"):
        record_class.maker(OURS[0])(*words, **more)


def test_it_is_for_nothing_else():
    with pytest.raises(TypeError, match="frozen records"):
        record_class.dataclass(frozen=False, slots=True)
