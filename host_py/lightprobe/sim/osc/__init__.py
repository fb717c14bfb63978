"""A RICOH THETA behind its published Web API (Open Spherical Camera, API 2.1), simulated."""
