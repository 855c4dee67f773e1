"""The width of the intervals that a report gives."""

__all__ = ["BAND"]

#: Half width of a 90 % interval in standard deviations.
BAND = 1.645
