"""CRC-16 in Python compared with fastcrc and with the check values of the catalogue."""

import runpy
import sys

import fastcrc
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common import crc16
from firmware_py.common.crc16 import table_checksum

ALGORITHMS = {
    "cms": (0x8005, 0xFFFF, False),
    "umts": (0x8005, 0x0000, False),
    "xmodem": (0x1021, 0x0000, False),
    "mcrf4xx": (0x8408, 0xFFFF, True),
}


@pytest.mark.parametrize(
    ("name", "check"), [("cms", 0xAEE7), ("umts", 0xFEE8), ("xmodem", 0x31C3), ("mcrf4xx", 0x6F91)]
)
def test_check_values_of_the_catalogue_with_and_without_fastcrc(monkeypatch, name, check):
    polynomial, initial, reflected = ALGORITHMS[name]
    assert table_checksum(polynomial, initial, reflected=reflected)(b"123456789") == check
    for has_fastcrc in (True, False):
        if not has_fastcrc:
            monkeypatch.setitem(sys.modules, "fastcrc", None)
        assert runpy.run_path(crc16.__file__)[name](b"123456789") == check


@pytest.mark.parametrize("name", ALGORITHMS)
@given(data=st.binary(max_size=300))
def test_python_equals_fastcrc(name, data):
    polynomial, initial, reflected = ALGORITHMS[name]
    assert table_checksum(polynomial, initial, reflected=reflected)(data) == getattr(fastcrc.crc16, name)(data)
