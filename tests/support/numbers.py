"""Numbers of enumerations: those of MAVLink, and those that logs and state files contain."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink


def assert_mavlink_numbers(kind, pattern, **other_names):
    """Check that the members have the numbers of the MAVLink names `pattern`, or of `other_names`."""
    for member in kind:
        assert member == getattr(mavlink, pattern.format(other_names.get(member.name, member.name))), member


def assert_stored_numbers(kind, names):
    """Check that the members have these names and are numbered from 0."""
    assert {member.name: member.value for member in kind} == {name: n for n, name in enumerate(names.split())}
