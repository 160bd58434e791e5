"""The error of the render package for bad input; `app` prints it as one line (exit status 2)."""


class InputError(ValueError):
    """Bad input: the message says what, what was expected, what was got, and the next command."""
