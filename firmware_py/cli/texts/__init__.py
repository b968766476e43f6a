"""What the texts mean that a ground station is told, and what to do: for the page alone, nothing at sea imports it."""
