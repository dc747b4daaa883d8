"""The simulated bench with its measuring chain, as the campaign states it."""
