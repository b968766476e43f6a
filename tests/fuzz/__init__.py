"""Fuzzing: every reader of bytes from outside is given what an engine makes of a corpus (`make fuzz`)."""
