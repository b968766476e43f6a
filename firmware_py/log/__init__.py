"""The onboard log: the DataFlash format, its background writer, its reader and the replay."""
