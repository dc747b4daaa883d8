"""What noise is like, and the filters that whiten it; arrays alone."""
