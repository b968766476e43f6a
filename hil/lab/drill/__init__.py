"""The drill book: every fault provoked on a boat at sea, at every kind of moment and in pairs."""
