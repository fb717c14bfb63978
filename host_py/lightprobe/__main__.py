"""`python -m lightprobe` is the command `lightprobe`."""

from lightprobe.cli import main

main()
