"""How good an estimate is: runs of the daemon over scenes, error measures, pictures."""
