"""A link by messages over a satellite: the modem, what is sent first, what it may cost, what counts as a command."""
