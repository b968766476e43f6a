"""What the framer makes of clean, nested, cut and foreign bytes."""

import pytest

from firmware_py.sensors.nmea_framing import MAX_BODY_LENGTH, NmeaFramer

HDG = b"$HCHDG,98.3,0.0,E,12.6,W*57"
HDT = b"$HEHDT,341.8,T*21"


def frame(data):
    framer = NmeaFramer()
    return [(found.line, found.address, found.fault) for found in framer.feed(data) + framer.finish()]


def test_a_sentence_is_split_into_its_fields():
    (sentence,) = NmeaFramer().feed(HDG)
    assert (sentence.address, sentence.talker, sentence.kind) == ("HCHDG", "HC", "HDG")
    assert sentence.fields == ("98.3", "0.0", "E", "12.6", "W")


def test_a_proprietary_sentence_has_talker_p_and_is_of_its_own_kind():
    (sentence,) = NmeaFramer().feed(b"$PASHR,142509.000,179.885,T,-0.624,0.245,,0.029,0.029,0.502,2,3*17\r\n")
    assert (sentence.talker, sentence.kind) == ("P", "PASHR")


@pytest.mark.parametrize("ending", [b"\r\n", b"\n", b"\r", b"", b"\n\r\n", b"\0"])
def test_any_line_ending_will_do(ending):
    assert [found[1:] for found in frame(HDG + ending + HDT + ending)] == [("HCHDG", ""), ("HEHDT", "")]


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
        (b"", []),
    ],
)
def test_garbage_is_judged_and_passed_over(data, expected):
    assert frame(data) == expected


def test_a_checksum_below_16_may_have_one_digit_at_the_end_of_the_line():
    both, one = b"$GPHDT,274.07,T*03", b"$GPHDT,274.07,T*3"
    assert frame(both + b"\r\n") == frame(one + b"\r\n") == frame(one + b"\n") == [(1, "GPHDT", "")]
    assert frame(one) == [(1, "GPHDT", "")]  # the end of a capture ends a line
    assert frame(one + b" ") == frame(b"$GPHDT,274.07,T*4\r\n") == [(1, "GPHDT", "checksum")]


def test_lines_are_counted_at_lf():
    assert [found[0] for found in frame(b"\n\r\n" + HDT + b"\r\n\r\r" + HDG + b"\n" + HDG)] == [3, 4, 5]


def test_an_endless_sentence_is_refused_and_what_follows_is_read():
    framer = NmeaFramer()
    found = framer.feed(b"$HEHDT," + b"1" * 100_000)
    found += framer.feed(b"1" * 100_000 + b"\r\n" + HDT)
    assert [(sentence.address, sentence.fault) for sentence in found] == [("HEHDT", "malformed"), ("HEHDT", "")]
    longest = b"$PUBX,03," + b"1" * (MAX_BODY_LENGTH - 8)
    assert [found[2] for found in frame(longest + b"*00\r\n")] == ["checksum"]
    assert [found[2] for found in frame(longest + b"1*00\r\n")] == ["malformed"]
