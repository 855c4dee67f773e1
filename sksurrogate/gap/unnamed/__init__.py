"""What no name explains: a law without a name, its place, its shape."""
