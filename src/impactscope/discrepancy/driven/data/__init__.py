"""Recordings as the models take them: segments, trajectories, the measured force."""
