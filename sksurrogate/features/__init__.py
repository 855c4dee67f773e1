"""Features for surrogate models."""

from sksurrogate.features._lag import LagEmbedding

__all__ = ["LagEmbedding"]
