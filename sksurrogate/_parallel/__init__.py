"""A second process for questions that do not wait for each other."""
