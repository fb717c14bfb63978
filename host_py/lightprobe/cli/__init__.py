"""One file per sub-command of `lightprobe`."""
