"""MAVLink commands: one table, and who carries each out."""
