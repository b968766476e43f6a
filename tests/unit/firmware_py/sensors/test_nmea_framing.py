"""Framing of NMEA 0183: fields, faults, line numbers, other bytes between sentences."""

import pytest

from firmware_py.sensors.nmea_framing import NmeaFramer

MAX_BODY_LENGTH = 1024

HDG = b"$HCHDG,98.3,0.0,E,12.6,W*57"
HDT = b"$HEHDT,341.8,T*21"


def frame(data):
    framer = NmeaFramer()
    return [(sentence.line, sentence.address, sentence.fault) for sentence in framer.feed(data) + framer.finish()]


def test_sentence_is_split_into_address_and_fields():
    (sentence,) = NmeaFramer().feed(HDG)
    assert (sentence.address, sentence.talker, sentence.kind) == ("HCHDG", "HC", "HDG")
    assert sentence.fields == ("98.3", "0.0", "E", "12.6", "W")
    (sentence,) = NmeaFramer().feed(b"$PASHR,142509.000,179.885,T,-0.624,0.245,,0.029,0.029,0.502,2,3*17\r\n")
    assert (sentence.talker, sentence.kind) == ("P", "PASHR")


@pytest.mark.parametrize("line_end", [b"\r\n", b"\n", b"\r", b"", b"\n\r\n", b"\0"])
def test_line_ends(line_end):
    assert [found[1:] for found in frame(HDG + line_end + HDT + line_end)] == [("HCHDG", ""), ("HEHDT", "")]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"$HEHDT,341.9,T*21\r\n", [(1, "HEHDT", "checksum")]),
        (b"$HEHDT,341.8,T*2G\r\n", [(1, "HEHDT", "checksum")]),
        (b"$GNVTG,,T,,M,0.145,N,0.269,K,A*3)\r\n", [(1, "GNVTG", "checksum")]),
        (b"$HEHDT,341.8,T\r\n", [(1, "HEHDT", "no checksum")]),
        (b"$HEHDT,341.8,T*\r\n", [(1, "HEHDT", "checksum")]),
        (b"$HEHDT,341.8,T*2\r\n", [(1, "HEHDT", "checksum")]),  # one digit, and 0x21 is not 0x02
        (b"$HEHDT,34" + HDG, [(1, "HEHDT", "malformed"), (1, "HCHDG", "")]),
        (b"$HEHDT,341.8,T*" + HDG, [(1, "HEHDT", "checksum"), (1, "HCHDG", "")]),
        (b"$HEHDT,341.8,T*2" + HDG, [(1, "HEHDT", "checksum"), (1, "HCHDG", "")]),
        (b"$HEHDT,34\x001.8,T*21\r\n", [(1, "HEHDT", "malformed")]),
        (b"2026-01-01 12:00:00 [gps] " + HDT + b" ok\r\n" + HDG, [(1, "HEHDT", ""), (2, "HCHDG", "")]),
        (rb"\s:gps,c:1428451253*2B\ "[:-1] + HDT, [(1, "HEHDT", "")]),  # a tag block of NMEA 4
        (b"!AIVDM,1,1,,A,13aEOK?P00PD2wVMdLDRhgvL289?,0*26\r\n" + HDT, [(1, "AIVDM", ""), (2, "HEHDT", "")]),
        (b"\xb5\x62\x01\x07\x5c\x00$\x11\xf7\n$" + HDT, [(2, "HEHDT", "")]),
        (b"$&bTXT,01*00\r\n$$$ $*21\r\n$\r\n$hehdt,341.8,T*01\r\n$HE", []),
        (b"\n\r\n" + HDT + b"\r\n\r\r" + HDG + b"\n" + HDG, [(3, "HEHDT", ""), (4, "HCHDG", ""), (5, "HCHDG", "")]),
        (b"", []),
    ],
)
def test_faults_line_numbers_and_skipped_bytes(data, expected):
    assert frame(data) == expected


def test_checksum_below_16_may_have_one_digit_at_the_end_of_the_line():
    sentence = b"$GPHDT,274.07,T*3"
    for data in (b"$GPHDT,274.07,T*03\r\n", sentence + b"\r\n", sentence + b"\n", sentence):
        assert frame(data) == [(1, "GPHDT", "")]
    for data in (sentence + b" ", b"$GPHDT,274.07,T*4\r\n"):
        assert frame(data) == [(1, "GPHDT", "checksum")]


def test_too_long_sentence_is_malformed_and_the_next_one_is_read():
    framer = NmeaFramer()
    sentences = framer.feed(b"$HEHDT," + b"1" * 100_000) + framer.feed(b"1" * 100_000 + b"\r\n" + HDT)
    assert [(sentence.address, sentence.fault) for sentence in sentences] == [("HEHDT", "malformed"), ("HEHDT", "")]
    longest = b"$PUBX,03," + b"1" * (MAX_BODY_LENGTH - 8)
    assert frame(longest + b"*00\r\n") == [(1, "PUBX", "checksum")]
    assert frame(longest + b"1*00\r\n") == [(1, "PUBX", "malformed")]
