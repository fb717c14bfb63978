"""`python -m lightprobe` is the command `lightprobe`."""

from lightprobe.cli.main import main

main()
