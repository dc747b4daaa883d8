"""Fits over all blows, where they start, and what they tell of noise and tap ends."""
