# SPDX-License-Identifier: Apache-2.0
"""Large values as keys of a cache: the same object, not equal numbers."""

from typing import Generic, TypeVar

T = TypeVar("T")


class Held(Generic[T]):
    """A value that equals only itself; holding it keeps its identity from being used again."""

    def __init__(self, value: T) -> None:
        """Take the value."""
        self.value = value

    def __hash__(self) -> int:
        """Hash the identity."""
        return id(self.value)

    def __eq__(self, other: object) -> bool:
        """Compare identities."""
        return isinstance(other, Held) and other.value is self.value
