"""Rudder servo drivers: one codec and one driver a protocol, and the half-duplex bus they share."""
