"""Discrepancy: where a simulation and recordings differ, and the physics that is missing."""
