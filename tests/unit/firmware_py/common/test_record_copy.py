from dataclasses import dataclass, field, replace

import pytest

from firmware_py.common import record_copy
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Tick
from firmware_py.core.state import State


@dataclass(frozen=True, slots=True)
class One:
    value: int = 1


@dataclass(frozen=True, slots=True)
class Checked:
    value: int = 1
    other: int = 2

    def __post_init__(self):
        assert self.value < self.other


@dataclass(frozen=True, slots=True)
class Made:
    value: int = 1
    items: list = field(default_factory=list)


@pytest.mark.parametrize(
    ("record", "changes"),
    [
        (Tick(1, 2.0, 0.1, 0, 10.0), {"skipped": 3, "index": 2}),
        (Tick(1, 2.0, 0.1, 0, 10.0), {}),
        (Tick(1, 2.0, 0.1, 0, 10.0), {"index": 2, "skipped": 3}),
        (One(), {"value": 7}),
        (State.at_start(ParameterSet()), {"greeting": "well", "home": None}),
    ],
)
def test_a_copy_is_that_of_the_standard_library(record, changes):
    copy = record_copy.replace(record, **changes)
    assert copy == replace(record, **changes)
    assert type(copy) is type(record)


def test_what_is_not_changed_is_shared_and_the_record_stays_as_it_was():
    record = Made(1, [1, 2])
    copy = record_copy.replace(record, value=2)
    assert copy.items is record.items
    assert record.value == 1


def test_a_field_that_is_not_there_is_refused():
    with pytest.raises(KeyError):
        record_copy.replace(One(), other=1)


def test_a_record_that_checks_itself_is_refused():
    with pytest.raises(TypeError, match=r"dataclasses\.replace"):
        record_copy.replace(Checked(), value=3)
