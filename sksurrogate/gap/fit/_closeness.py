"""How far a free run is from the data, in units of the noise."""

__all__ = ["FAR"]

#: Free runs further than this many times the noise are far from the data: no noise model holds there.
FAR = 5.0
