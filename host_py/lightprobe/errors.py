"""What every error of this package has in common."""


class LightprobeError(Exception):
    """Something that the user has to know: names object, stage and next step.

    The command line prints it without a traceback and ends with `exit_code`.
    """

    exit_code = 1


class UsageError(LightprobeError):
    """What was asked for makes no sense."""

    exit_code = 2


class ImageError(LightprobeError):
    """A picture that cannot be read; says which, at which stage, and what to do."""


class ProbeError(LightprobeError):
    """Something that a user of the client has to know."""


class ProbeTimeout(ProbeError, TimeoutError):  # noqa: N818 - reads as what it is
    """No estimate came in the time given."""


class MissingPackage(ProbeError):  # noqa: N818
    """A Python package is not installed; trying again would not help."""


class IncompatibleProbe(ProbeError):  # noqa: N818
    """The probe speaks another major version of the protocol; trying again would not help."""
