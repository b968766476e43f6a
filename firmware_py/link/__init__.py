"""Links to ground stations: MAVLink over UDP, TCP, serial lines and satellite, and output of NMEA 0183."""
