"""The fixed rotation from the probe to the head or device that carries it."""
