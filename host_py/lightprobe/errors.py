"""What every error of this package has in common."""


class LightprobeError(Exception):
    """Something that the user has to know: names object, stage and next step.

    The command line prints it without a traceback and ends with `exit_code`.
    """

    exit_code = 1


class UsageError(LightprobeError):
    """What was asked for makes no sense."""

    exit_code = 2
