"""All exceptions of the package. Misuse and broken input raise; an expected failure, such as a lost frame, is a value.

Every message is one line: what is wrong, and what would be right. An error that ends the process is caught in one
place, `stab_ros.cli.main` or the `main` of a node. An error of a single message, frame or parameter change is caught
where it is counted or reported.
"""


class StabRosError(Exception):
    """Base class of all errors that stab_ros raises on purpose; any other exception is a bug."""


class InputError(StabRosError):
    """Unusable input of the user, such as a file, topic, parameter or polygon; exit code 2."""


class ConfigError(InputError):
    """A parameter is unknown, of the wrong type or out of range."""


class MessageError(InputError):
    """A message that contradicts its type (size, step, encoding); the receiver drops and counts it."""


class WorkError(StabRosError):
    """Work that could not be finished (disk full, output folder gone); exit code 1."""
