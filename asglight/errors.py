# SPDX-License-Identifier: Apache-2.0
"""The one error that means: the input is at fault, not the program. Numbers that raise it."""

import numbers


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


def check_whole(name: str, value: object) -> None:
    """Refuse what is no whole number of Python or numpy: 2.5, True, text, an array.

    Raises:
        InputError: It is none.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise InputError(f"{name}: {_told(value)}; expected a whole number.")


def check_number(name: str, value: object) -> None:
    """Refuse what is no real number of Python or numpy: True, text, an array.

    Raises:
        InputError: It is none.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(f"{name}: {_told(value)}; expected a number.")


def _told(value: object) -> str:
    is_short = value is None or isinstance(value, numbers.Number | str)
    return f"{value!r:.60}" if is_short else f"of type {type(value).__name__}"
