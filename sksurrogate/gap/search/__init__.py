"""Which set of effects: forward and backward search by evidence."""
