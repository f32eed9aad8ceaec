"""The work of the commands: stabilize, evaluate, compare, convert, recover and info, as functions."""
