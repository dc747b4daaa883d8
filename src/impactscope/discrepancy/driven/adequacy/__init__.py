"""Whether something is left that no known effect explains: laws along the motion."""
