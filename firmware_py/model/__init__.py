"""The K-T model of the boat, shared with the HIL so that there is one of it."""
