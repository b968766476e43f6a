"""What a run came to: the figures, the pictures, the page."""
