"""The report for the eye: sentences, terminal, page, figure."""
