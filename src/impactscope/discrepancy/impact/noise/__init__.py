"""What noise is like before a blow, and the filter that whitens it; arrays alone."""
