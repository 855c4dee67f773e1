"""Which candidates deserve a fit: one linearisation orders them."""
