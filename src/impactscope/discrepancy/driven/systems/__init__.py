"""Each kind of system with its baseline, its noise and its candidates."""
