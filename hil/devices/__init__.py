"""Byte-level device emulators, written from the makers' protocols and independent of the drivers."""
