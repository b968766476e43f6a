"""The shore side of a boat's satellite link: messages in, a ground station, messages out."""
