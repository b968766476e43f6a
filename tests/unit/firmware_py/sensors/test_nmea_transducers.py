"""Transducers of XDR: names, units and limits of instruments."""

import pytest

from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer
from firmware_py.sensors.nmea_sentences import decode_sentence


def decode(raw):
    (sentence,) = NmeaFramer().feed(raw)
    return decode_sentence(sentence)


AIRMAR = {"air_pressure_pa": 101640.0, "wind_chill_relative_c": 24.4, "wind_chill_theoretical_c": 23.9,
          "heat_index_c": 25.1}  # fmt: skip


@pytest.mark.parametrize(
    ("body", "numbers"),
    [  # from the documents that docs/reference/nmea-sentences.md lists
        ("YXXDR,A,1.2,D,PTCH,A,-3.4,D,ROLL", {"pitch_deg": 1.2, "roll_deg": -3.4}),
        ("YXXDR, A,0.1,D,PTCH, A,-2.0,D,ROLL", {"pitch_deg": 0.1, "roll_deg": -2.0}),
        ("YXXDR,C,24.4,C,WCHR,C,23.9,C,WCHT,C,25.1,C,HINX,P,1.0164,B,STNP", AIRMAR),
        ("YXXDR,C,,C,WCHR,,,,,C,25.1,C,HINX,P,1.0164,B,STNP",
         {"wind_chill_relative_c": None, "heat_index_c": 25.1, "air_pressure_pa": 101640.0}),
        ("YXXDR,P,0.98966,B", {"air_pressure_pa": 98966.0}),
        ("YXXDR,C,29.9,C", {"air_temperature_c": 29.9}),
        ("WIXDR,C,022.0,C,,", {"air_temperature_c": 22.0}),
        ("IIXDR,C,28.7,C,ENV_OUTSIDE_T,P,101400,P,ENV_ATMOS_P,H,47.38,P,ENV_OUTSIDE_H",
         {"air_temperature_c": 28.7, "air_pressure_pa": 101400.0, "humidity_percent": 47.38}),
        ("IIXDR,C,18.2,C,ENV_WATER_T,C,28.69,C,ENV_OUTAIR_T",
         {"water_temperature_c": 18.2, "air_temperature_c": 28.69}),
        ("YDXDR,C,6.2,C,Sea_T,H,59.5,P,ENV_INSIDE_H,C,15.6,C,ENV_INSIDE_T",
         {"water_temperature_c": 6.2, "inside_humidity_percent": 59.5, "inside_temperature_c": 15.6}),
        ("YDXDR,A,-4.5,D,Yaw,A,0.75,D,Pitch,A,1.0,D,Roll", {"yaw_deg": -4.5, "pitch_deg": 0.75, "roll_deg": 1.0}),
        ("IIXDR,P,1.02481,B,Barometer", {"air_pressure_pa": 102481.0}),
        ("IIXDR,P,1013.2,B,Barometer,C,19.52,C,TempAir", {"air_pressure_pa": 101320.0, "air_temperature_c": 19.52}),
        ("WIXDR,C,71.6,F,Air,H,50,P,Air", {"air_temperature_c": 22.0, "humidity_percent": 50.0}),
        ("WIXDR,C,23.3,C,0,C,24.0,C,1,H,50.1,P,0,P,1009.5,H,0",
         {"air_temperature_c": 23.3, "inside_temperature_c": 24.0, "humidity_percent": 50.1,
          "air_pressure_pa": 100950.0}),
        ("IIXDR,A,4.5,D,Rudder#0", {"rudder_deg": 4.5}),
        ("IIXDR,C,C,10.7,C,AIRTEMP,A,0.5,D,HEEL,A,-1.-3,D,TRIM,P,1.026,B,BARO,A,A,-4.-3,D,RUDDER",
         {"air_temperature_c": 10.7, "heel_deg": 0.5, "trim_deg": -1.3, "air_pressure_pa": 102600.0,
          "rudder_deg": -4.3}),
        ("IIXDR,10.7,C,AIRTEMP,A,0.5,D,HEEL", {"air_temperature_c": 10.7, "heel_deg": 0.5}),
        ("WIXDR,C,293.15,K,AIR,P,29.92,I,BARO,S,36,K,1",
         {"air_temperature_c": 20.0, "air_pressure_pa": 101320.76, "wind_speed_m_s": 10.0}),
        ("WIXDR,C,14,F,AIR,P,760,M,BARO,S,10,N,1",
         {"air_temperature_c": -10.0, "air_pressure_pa": 101325.02, "wind_speed_m_s": 5.144444}),
        ("WIXDR,P,500,B,BARO,S,10,S,1", {"air_pressure_pa": 5e4, "wind_speed_m_s": 4.4704}),
    ],
)  # fmt: skip
def test_transducers_of_instruments(nmea, body, numbers):
    decoded = decode(nmea(body))
    assert decoded.unknown == ()
    assert decoded.numbers == {
        name: value if value is None else pytest.approx(value) for name, value in numbers.items()
    }


def test_unknown_transducers_are_named(nmea):
    decoded = decode(
        nmea("WIXDR,A,302,D,0,A,320,D,1,S,0.1,M,0,S,0.2,M,1,U,11.99,V,BRDV,G,5,,,TYPE,7,UNIT,ABCDEFGHIJKLMNOPQRSTUVW")
    )
    assert decoded.numbers == {"wind_angle_deg": 320.0, "wind_speed_m_s": 0.2}
    unknown = "0 (type A, unit D)|0 (type S, unit M)|BRDV (type U, unit V)|no name (type G, unit )"
    unknown += "|ABCDEFGHIJKLMNOPQRST (type TYP, unit UNI)"
    assert decoded.unknown == tuple(unknown.split("|"))


@pytest.mark.parametrize(
    "body",
    ["YXXDR,A,181,D,PTCH", "YXXDR,C,1,D,WCHR", "YXXDR,P,1.6,B,STNP", "YXXDR,P,499.9,B,STNP", "YXXDR,C, 7,C,WCHR"],
)
def test_known_transducer_with_an_invalid_value_is_rejected(nmea, body):
    with pytest.raises(MessageError, match=r"^YXXDR: \w+"):
        decode(nmea(body))


@pytest.mark.parametrize(
    ("body", "low", "high"),
    [
        *((f"YXXDR,A,{{}},D,{name}", -180, 180) for name in ("PTCH", "ROLL", "HEEL", "LEEWAY")),
        *((f"YXXDR,C,{{}},C,{name}", -100, 100) for name in ("AIRTEMP", "ENV_INSIDE_T")),
        *((f"YXXDR,C,{{}},C,{name}", -150, 100) for name in ("WCHR", "WCHT")),
        *((f"YXXDR,H,{{}},P,{name}", 0, 100) for name in ("AIR", "ENV_INSIDE_H")),
        ("YXXDR,A,{},D,TRIM", -90, 90), ("YXXDR,A,{},D,RUDDER", -90, 90), ("YXXDR,A,{},D,YAW", -360, 360),
        ("YXXDR,A,{},D,1", 0, 360), ("YXXDR,S,{},M,1", 0, 200), ("YXXDR,C,{},C,SEA_T", -10, 100),
        ("YXXDR,C,{},C,HINX", -150, 150), ("YXXDR,P,{},P,BARO", 5e4, 1.5e5),
    ],
)  # fmt: skip
def test_values_beyond_their_limits_are_rejected(nmea, body, low, high):
    margin = 0.004 * (high - low)
    for value in (low, high):
        assert list(decode(nmea(body.format(value))).numbers.values()) == [value]
    for value in (low - margin, high + margin):
        with pytest.raises(MessageError, match="out of range"):
            decode(nmea(body.format(f"{value:.6f}")))
