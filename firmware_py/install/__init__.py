"""Installation as a systemd service: unit, user, device names, directories; updates on trial."""
