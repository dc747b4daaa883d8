"""Arrays in, arrays out: interpolation, filters and decimation, without I/O and without units."""
