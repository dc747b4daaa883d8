"""What may be missing or wrong: mechanisms, effects of channels, stated numbers."""
