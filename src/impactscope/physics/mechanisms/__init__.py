"""Physical effects, one a file."""
