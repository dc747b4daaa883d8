"""Equations of motion and of the measuring chain, and the effects that may be missing."""
