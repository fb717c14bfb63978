"""Checks of a box with its microcontroller: evidence that a real one works (`lightprobe hil`)."""
