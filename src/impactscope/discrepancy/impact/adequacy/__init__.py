"""Whether a fit leaves only noise: tests against laws along the motion."""
