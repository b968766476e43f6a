"""Compass and position drivers, and the decoder that runs captures through their code."""
