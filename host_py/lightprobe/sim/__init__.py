"""The simulated world: scenes, camera physics, and the link to the daemon (proto/sim.md)."""
