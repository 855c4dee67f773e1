"""What a diagnosis returns: frozen parts of the report."""
