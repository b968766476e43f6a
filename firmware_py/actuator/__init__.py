"""Rudder servo drivers: a codec and a driver for each protocol, and the common half-duplex bus."""
