"""Watches what goes wrong: pure judges of conditions, rudder and energy."""
