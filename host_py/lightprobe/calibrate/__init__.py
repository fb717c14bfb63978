"""Calibration of cameras, of the wheel's servo and of the ring's sensors, and its files."""
