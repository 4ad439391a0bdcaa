# SPDX-License-Identifier: Apache-2.0
"""Pictures of the reference pass that are not shown now, finished or not, within a budget."""

from collections import OrderedDict
from collections.abc import Hashable

from asglight.viewer.gl.reference.reference_pass import Accumulation


class ReferenceCache:
    """Holds accumulations by a key of map, balls, camera and cells; drops the longest unused.

    It owns what was put in until it is taken out: `put(key, reference.detach())` when the view
    changes, then `reference.resume(found)` if `found = cache.take(new_key)` is one, else
    `reference.restart(...)`.
    """

    def __init__(self, budget_bytes: int) -> None:
        """Begin empty; the budget is for the targets on the GPU."""
        self._budget_bytes = budget_bytes
        self._held: OrderedDict[Hashable, Accumulation] = OrderedDict()

    def __contains__(self, key: Hashable) -> bool:
        """Return whether there is a picture for a key."""
        return key in self._held

    @property
    def byte_count(self) -> int:
        """Bytes held now."""
        return sum(accumulation.byte_count for accumulation in self._held.values())

    def put(self, key: Hashable, accumulation: Accumulation) -> None:
        """Keep a picture; it replaces one of the same key, and may push older ones out.

        One that exceeds the budget alone is dropped at once.
        """
        self._held.pop(key, None)
        self._held[key] = accumulation
        while self.byte_count > self._budget_bytes:
            self._held.popitem(last=False)

    def take(self, key: Hashable) -> Accumulation | None:
        """Hand a picture over, or return None."""
        return self._held.pop(key, None)
