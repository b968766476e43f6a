"""Plans: allowed content, and plan files."""
