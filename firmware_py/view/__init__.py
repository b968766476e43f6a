"""What a voyage looks like in a browser: one page for a run, for a boat's logs and for a boat under way."""
