"""Ground: the equations of sensor, damper layer, impactor and contact; SI units, no I/O."""
