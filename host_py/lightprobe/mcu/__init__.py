"""The microcontroller: its messages, the carriers that take them, and a session with it."""
