# SPDX-License-Identifier: Apache-2.0
"""The one error that means: the input is at fault, not the program."""


class InputError(ValueError):
    """The user's input cannot be used.

    The message is one line: `<file or argument>: <what was found>; expected <what>. <fix>`.
    The command line prints it without a traceback and exits with 2.

    Examples:
        >>> try:
        ...     asglight.fit_sequence("none.exr")
        ... except asglight.InputError as error:
        ...     print(str(error).partition(":")[0])
        none.exr
    """
