"""What may be said: held-out runs, equivalence classes, certificate, verdict."""
