"""Byte-level device emulators, written from the makers' protocols and not from the drivers."""
