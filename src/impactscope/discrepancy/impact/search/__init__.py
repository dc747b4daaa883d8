"""The search for the mechanisms that are missing, over windows that grow."""
