"""Fuzzing of all readers of external bytes with inputs that an engine derives from a corpus (`make fuzz`)."""
