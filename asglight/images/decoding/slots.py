# SPDX-License-Identifier: Apache-2.0
"""How rows of a decoded image lie in the memory that two processes share."""

SLOTS = 2
"""In the shared memory: while the rows in one are taken, the other is filled."""

SLOT_BYTES = 2**24
"""Of a slot, at most: a frame of 1024 x 512 float32 texels at once, and one of the fit's 512 x 256
four times over, so that the process that fits is asked once a frame."""


def slot_rows(height: int) -> int:
    """Return how many rows of a result a slot takes."""
    return min(height, max(1, SLOT_BYTES // row_bytes(height)))


def row_bytes(height: int) -> int:
    """Return the size of a row of a result: 2 * height texels of three float32."""
    return 2 * height * 3 * 4
