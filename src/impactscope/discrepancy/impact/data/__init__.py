"""Recordings of blows made ready for a fit: onset, noise, bins."""
