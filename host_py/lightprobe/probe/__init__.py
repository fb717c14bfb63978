"""Probes for nothing: balls beside a printed board, in the pictures of an ordinary camera."""
