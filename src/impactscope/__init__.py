"""Live impact testing of collaborative robots."""
