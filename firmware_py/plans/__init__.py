"""What a plan may hold, and the files that plans come in."""
