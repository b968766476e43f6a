"""The NMEA 0183 drivers: a compass and a position receiver."""

from firmware_py.sensors.nmea_compass import NmeaCompass
from firmware_py.sensors.nmea_position import NmeaPosition

__all__ = ["NmeaCompass", "NmeaPosition"]
