"""Campaign specifications of any shape are read, or refused with lines that name each problem."""

import functools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.errors import UsageError
from hil.lab.campaign.campaign import read_spec
from hil.lab.campaign.row import rows
from hil.lab.campaign.spec import KEYS, SpecError
from hil.ship.disturbance_options import BY_NAME
from support.campaign import COMPILED, read
from support.paths import ROOT

NUMBERS = st.integers() | st.floats() | st.sampled_from([10**400, -(10**400), 2**63, 2**63 + 1, 0, 1, True, False])
TEXTS = st.text(max_size=8) | st.sampled_from(["0:0", "tank", "swell+leeway=3", "nmea", "none", "killed", "a\0b", "\n"])
VALUES = st.recursive(
    NUMBERS | TEXTS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(TEXTS | st.sampled_from(["uniform", "log_uniform", "normal"]), inner, max_size=2)
    ),
    max_leaves=6,
)
WORDS = st.sampled_from(["K", "T", "what", "at_s", "for_s", "CTL_PRICE", "rms_deg", "MDL_K", *BY_NAME]) | TEXTS
TABLES = st.dictionaries(WORDS, VALUES, max_size=4)


def read_or_refuse(reader):
    """Return the specification, None if it is refused, and the lines of the refusal."""
    try:
        return reader(), []
    except (SpecError, UsageError) as error:
        return None, str(error).splitlines()


@given(st.dictionaries(st.sampled_from(KEYS) | TEXTS, VALUES | TABLES, max_size=5))
def test_any_content_gives_rows_or_is_refused_by_name(content):
    spec, problems = read_or_refuse(lambda: read({**COMPILED, "runs": 3, **content}))
    assert all(line.isprintable() and ": " in line for line in problems)
    if spec is None:
        assert problems
        return
    first_rows = list(rows(spec, 0, min(3, spec.runs)))
    assert all(draw.limits()[0] is not None for draw in spec.draws.values())
    assert [row.seconds for row in first_rows] == [spec.seconds] * len(first_rows)


@functools.cache
def example():
    return (ROOT / "params" / "campaign_twin.toml").read_bytes()


@given(st.data())
def test_file_with_changed_bytes_is_read_or_refused_with_its_path(tmp_path_factory, data):
    data_bytes = bytearray(example())
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(data_bytes) - 1))
        data_bytes[position : position + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=6))
    path = tmp_path_factory.getbasetemp() / "spec.toml"
    path.write_bytes(data_bytes)
    spec, problems = read_or_refuse(lambda: read_spec(path))
    assert (spec is None) == bool(problems)
    assert all(line.startswith(f"{path}: ") for line in problems)


@pytest.mark.parametrize(
    "text", ["x = " + 5000 * "[", "runs = " + 5000 * "1", "a.b.c = 1\na = 2", "engine = 1979-05-27"]
)
def test_nested_long_or_contradictory_file_is_refused(tmp_path, text):
    path = tmp_path / "spec.toml"
    path.write_text(text)
    with pytest.raises(UsageError):
        read_spec(path)
