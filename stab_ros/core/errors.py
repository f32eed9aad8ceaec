"""The one error tree: misuse and broken input raise, expected failure (a lost frame) is a value.

Every message is one line that says what is wrong and what would be right. It is caught once per process, in
`stab_ros.cli.main` and in the `main` of each node.
"""


class StabRosError(Exception):
    """Root of all errors that stab_ros raises on purpose; anything else that escapes is a bug."""


class InputError(StabRosError):
    """What the user gave cannot be used (file, topic, parameter, polygon): exit code 2."""


class ConfigError(InputError):
    """A parameter is unknown, of the wrong type or out of range."""


class MessageError(InputError):
    """A message is not what its type claims (size, step, encoding): drop it, count it, go on."""


class WorkError(StabRosError):
    """Work broke off half way (disk full, output folder gone): exit code 1."""
