# SPDX-License-Identifier: Apache-2.0
"""A recorder of steps that needs no GPU, and lobes that say they are on one."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from asglight.lobes import Lobes


class Tape:
    """Does each operation again, on the memory on which it was recorded, as a CUDA graph does.

    Python does not run again: what it read from numbers and caches stays as it was.
    """

    def __init__(self, device: torch.device) -> None:
        self.device = device
        self.events: list[str] = []
        self._operations: list[Callable[[], None]] = []

    def warm_up(self, function: Callable[[], None]) -> None:
        self.events.append("warm-up")
        function()

    def record(self, function: Callable[[], None]) -> None:
        self.events.append("record")
        with _Recording() as recording:
            function()
        recording.undo()
        self._operations = recording.operations

    def replay(self) -> None:
        self.events.append("replay")
        with torch.inference_mode():  # which may write to tensors of either kind
            for again in self._operations:
                again()


class _Recording(TorchDispatchMode):
    """Notes operations, and what memory from outside held before they wrote to it."""

    def __init__(self) -> None:
        super().__init__()
        self.operations: list[Callable[[], None]] = []
        self._made: set[int] = set()
        self._before: list[tuple[Tensor, Tensor]] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if func._schema.is_mutable:  # the first argument, of all that a step does
            outside = _memory(args[0]) not in self._made
            if outside:
                self._before.append((args[0], args[0].clone()))
        out = func(*args, **kwargs)
        taken = {_memory(each) for each in tensors_among((args, tuple(kwargs.values())))}
        made = [each for each in tensors_among(out) if _memory(each) not in taken]
        self._made.update(map(_memory, made))

        def again() -> None:
            found = [each for each in tensors_among(func(*args, **kwargs)) if each.numel()]
            own = [each for each in tensors_among(out) if each.numel()]
            for old, new in zip(own, found, strict=True):
                if any(old is each for each in made):  # else a view of what is there already
                    old.copy_(new)

        self.operations.append(again)
        return out

    def undo(self) -> None:
        """Put back what was there: a capture runs nothing."""
        for tensor, before in reversed(self._before):
            tensor.copy_(before)


def tensors_among(values: Any) -> Iterator[Tensor]:
    """Yield the tensors among the arguments or results of an operation."""
    if isinstance(values, Tensor):
        yield values
    elif isinstance(values, list | tuple):
        for each in values:
            yield from tensors_among(each)


def _memory(tensor: Tensor) -> int:
    return tensor.untyped_storage().data_ptr()


class _OnDevice(Tensor):
    """A tensor that says it is on a GPU; what is computed from it is a plain one."""

    is_cuda = True  # type: ignore[assignment]
    __torch_function__ = torch._C._disabled_torch_function_impl  # type: ignore[assignment]


def on_device(lobes: Lobes) -> Lobes:
    """Return lobes that say they are on a GPU, though they are not."""
    return replace(lobes, axes=lobes.axes.as_subclass(_OnDevice))
