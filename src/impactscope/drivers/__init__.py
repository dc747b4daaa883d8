"""Where samples come from: devices, the simulated bench, recordings. No ROS."""
