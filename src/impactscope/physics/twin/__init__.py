"""The twin: the bench in the time domain, as a list of mechanisms."""
