"""The ground stations' side: MAVLink 2 over UDP, TCP and serial lines."""
