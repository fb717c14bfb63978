"""The fixtures `probe`, `room`, `camera` and `box`."""

pytest_plugins = ["lightprobe.testing.plugin"]
