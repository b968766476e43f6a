"""Numbers of enumerations and defaults of records: those of MAVLink, and those of logs and state files."""

import msgspec
from msgspec.structs import NODEFAULT, fields
from pymavlink.dialects.v20 import ardupilotmega as mavlink


def assert_mavlink_numbers(kind, pattern, **other_names):
    """Check that the members have the numbers of the MAVLink names `pattern`, or of `other_names`."""
    for member in kind:
        assert member == getattr(mavlink, pattern.format(other_names.get(member.name, member.name))), member


def assert_stored_numbers(kind, names):
    """Check that the members have these names and are numbered from 0."""
    assert {member.name: member.value for member in kind} == {name: n for n, name in enumerate(names.split())}


def assert_missing_values_are_empty(module, **others):
    """Check that a field of a record that an older log does not contain is 0, False, empty or None.

    `others` are the fields with another default, by name.
    """
    kinds = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]
    defaults = {}
    for kind in kinds:
        for field in fields(kind):
            values = field.default if isinstance(field.default, tuple) else (field.default,)
            if kind.__module__ == module.__name__ and any(
                value for value in values if value is not NODEFAULT and not isinstance(value, msgspec.Struct)
            ):
                defaults[field.name] = field.default
    assert defaults == others
