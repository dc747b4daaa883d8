"""Fits of simulated to recorded channels, where they start, and their linearisation."""
