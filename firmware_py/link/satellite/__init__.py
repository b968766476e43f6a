"""A link by messages over a satellite: modem, priorities, budget, commands with a key."""
