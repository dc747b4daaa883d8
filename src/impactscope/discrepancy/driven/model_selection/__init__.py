"""When one fit explains recordings better than another."""
