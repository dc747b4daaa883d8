"""The search for the effects that are missing, forwards and backwards."""
