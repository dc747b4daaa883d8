"""Compliance: from a blow to a verdict against the limits of the body region that was tested."""
