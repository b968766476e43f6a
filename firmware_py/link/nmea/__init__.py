"""NMEA 0183 for plotters, loggers and other instruments: they listen, and cannot steer her."""
