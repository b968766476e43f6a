from firmware_py.common.records import RudderFeedback
from firmware_py.system.readings import rudder_values


def test_values_of_a_servo_are_rounded_to_their_accuracy():
    sample = RudderFeedback(1.0, 0.123456, 21.5, 12.3456, 0.123456, 4)
    assert rudder_values(sample) == {
        "shaft_deg": 7.07,
        "temperature_c": 21.5,
        "voltage_v": 12.35,
        "current_a": 0.123,
        "hardware_error": 4,
    }
    assert rudder_values(RudderFeedback(1.0))["current_a"] is None
