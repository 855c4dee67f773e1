"""How a set of effects is fitted to the record: free run, noise, likelihood, prior."""
