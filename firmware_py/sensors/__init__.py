"""Drivers of compass, position, power and AIS devices, and the decoder of captures, which uses their code."""
