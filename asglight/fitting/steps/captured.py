# SPDX-License-Identifier: Apache-2.0
"""Steps of one kind on a GPU: recorded once as a CUDA graph, then replayed.

A step of Levenberg-Marquardt is several hundred short operations, each of which Python has to
start; a graph starts all of them at once. It reads and writes the same memory each time, so a step
gets buffers of its own: what it is given is copied in, each replay goes on from what the one before
left there, and what came out is copied out.

The first steps of a kind are taken as they are, for libraries set themselves up in them and
constants come to the device; a kind that is met no more is never recorded.
"""

import warnings
from collections.abc import Callable, Hashable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, Generic, Protocol, TypeVar

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

State = TypeVar("State")
Given = TypeVar("Given")

WARM_UPS = 2
"""Steps of a kind before it is recorded: the first brings constants to the device, the second finds
them there."""

MOST = 32
"""Kinds that are kept. A first frame meets nine, and the nine frames after it two in `handheld` and
eight in `tunnel`, by their trials and corners."""


class Recorder(Protocol):
    """What records a function's work on a device."""

    def warm_up(self, function: Callable[[], None]) -> None:
        """Call a function as it will be recorded."""
        ...

    def record(self, function: Callable[[], None]) -> None:
        """Record what a function would do, without doing it; a RuntimeError says why not."""
        ...

    def replay(self) -> None:
        """Do what was recorded, on the memory on which it was recorded."""
        ...


class GraphRecorder:
    """Records a CUDA graph."""

    def __init__(self, device: torch.device) -> None:
        """Record nothing yet.

        Args:
            device: A CUDA device.
        """
        self._device = device
        self._graph: torch.cuda.CUDAGraph | None = None

    def warm_up(self, function: Callable[[], None]) -> None:
        """Call a function on the stream of recordings: libraries set up one by one."""
        own, current = _stream(self._device), torch.cuda.current_stream(self._device)
        own.wait_stream(current)
        with torch.cuda.stream(own):
            function()
        current.wait_stream(own)

    def record(self, function: Callable[[], None]) -> None:
        """Capture a function."""
        graph, own = torch.cuda.CUDAGraph(), _stream(self._device)
        # what other threads do on the GPU meanwhile is no part of it
        capture = torch.cuda.graph(graph, stream=own, capture_error_mode="thread_local")
        with torch.cuda.stream(own), capture:  # a capture that fails does not leave its stream
            function()
        self._graph = graph

    def replay(self) -> None:
        """Launch the graph."""
        assert self._graph is not None
        self._graph.replay()


@lru_cache(maxsize=16)
def _stream(device: torch.device) -> torch.cuda.Stream:
    """Return the stream of all recordings on a device: libraries keep memory for each stream."""
    return torch.cuda.Stream(device)


class Replays:
    """Recorded steps by their kind: all that a step does, but for the numbers in its tensors."""

    def __init__(
        self, recorder: Callable[[torch.device], Recorder] = GraphRecorder, most: int = MOST
    ) -> None:
        """Keep nothing yet.

        Args:
            recorder: Makes what records a step on a device.
            most: Kinds that are kept; the one that was not met for longest goes.
        """
        self._recorder = recorder
        self._most = most
        self._steps: dict[Hashable, _Step[Any, Any]] = {}

    def __len__(self) -> int:
        """Return how many kinds are kept."""
        return len(self._steps)

    def run(
        self,
        step: Callable[[State, Given], State],
        state: State,
        given: Given,
        times: int,
        on_step: Callable[[State], None] | None = None,
    ) -> State:
        """Take steps.

        Args:
            step: Returns the next state, of the same shapes, in tensors of its own. It is told
                apart by identity, and depends on nothing but what it is given.
            state: Where to start: a tensor, or dataclasses and tuples of them, of numbers and None.
            given: What steps do not change, in the same way.
            times: How many steps.
            on_step: Called after each with the state, which the next one overwrites.

        Returns:
            The state after them, in memory of its own.
        """
        kind = (step, kind_of(state), kind_of(given))
        # while it is in use it is not there: a second thread gets buffers of its own
        own = self._steps.pop(kind, None) or _Step(step, state, given, self._recorder)
        own.load(state, given)
        for _ in range(times):
            own.advance()
            if on_step is not None:
                on_step(own.state)
        found = mapped(own.state, torch.clone)
        self._steps[kind] = own
        while len(self._steps) > self._most:
            self._steps.pop(next(iter(self._steps)), None)
        return found


class _Step(Generic[State, Given]):
    """A step on buffers of its own.

    Attributes:
        state: The buffers of the state.
    """

    def __init__(
        self,
        step: Callable[[State, Given], State],
        state: State,
        given: Given,
        recorder: Callable[[torch.device], Recorder],
    ) -> None:
        self._step = step
        self.state: State = mapped(state, _buffer)
        self._given: Given = mapped(given, _buffer)
        self._recorder: Recorder | None = recorder(tensors_of(state)[0].device)
        self._warm_ups = 0
        self._read: list[Tensor] | None = None

    def load(self, state: State, given: Given) -> None:
        """Copy a state, and what is given, into the buffers."""
        _copy(state, self.state)
        _copy(given, self._given)

    def advance(self) -> None:
        """Take a step from the state in the buffers."""
        if self._recorder is None:
            self._call()
        elif self._read is not None:
            self._recorder.replay()
        elif self._warm_ups < WARM_UPS:
            self._warm_ups += 1
            self._recorder.warm_up(self._call)
        else:
            self._record(self._recorder)
            self.advance()

    def _call(self) -> None:
        _copy(self._step(self.state, self._given), self.state)

    def _record(self, recorder: Recorder) -> None:
        """Record the step, or never try again."""
        try:
            with _Read() as read:
                recorder.record(self._call)
        except RuntimeError as error:
            self._recorder = None
            warnings.warn(
                f"CUDA: steps of one kind run without a graph, which takes longer: {error}",
                RuntimeWarning,
                stacklevel=2,
            )
            return
        self._read = read.tensors


class _Read(TorchDispatchMode):
    """Holds what is read that was there before.

    A graph knows addresses alone. Constants are cached (constants.py, grid.py, probes.py) and would
    go with their place in the cache.
    """

    def __init__(self) -> None:
        super().__init__()
        self.tensors: list[Tensor] = []
        self._known: set[int] = set()

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        kwargs = kwargs or {}
        for tensor in _tensors_among((args, tuple(kwargs.values()))):
            if _memory(tensor) not in self._known:
                self._known.add(_memory(tensor))
                self.tensors.append(tensor)
        out = func(*args, **kwargs)
        self._known.update(map(_memory, _tensors_among(out)))
        return out


def _tensors_among(values: Any) -> Iterator[Tensor]:
    """Yield the tensors among the arguments or results of an operation."""
    if isinstance(values, Tensor):
        yield values
    elif isinstance(values, list | tuple):
        for each in values:
            yield from _tensors_among(each)


def _memory(tensor: Tensor) -> int:
    return tensor.untyped_storage().data_ptr()


def mapped(value: Any, of: Callable[[Tensor], Tensor]) -> Any:
    """Return a value with another tensor for each tensor in it.

    Args:
        value: Dataclasses and tuples of tensors and other values.
        of: Gives the other tensor.
    """
    if isinstance(value, Tensor):
        return of(value)
    if isinstance(value, tuple):
        return tuple(mapped(each, of) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        parts = {each.name: mapped(getattr(value, each.name), of) for each in fields(value)}
        return replace(value, **parts)
    return value


def tensors_of(value: Any) -> list[Tensor]:
    """Return the tensors in a value, in the order of `mapped`."""
    found: list[Tensor] = []

    def noted(tensor: Tensor) -> Tensor:
        found.append(tensor)
        return tensor

    mapped(value, noted)
    return found


def kind_of(value: Any) -> Hashable:
    """Return all that there is to a value but for the numbers in its tensors.

    Args:
        value: Dataclasses and tuples of tensors and hashable values.
    """
    if isinstance(value, Tensor):
        return (tuple(value.shape), value.dtype, value.device)
    if isinstance(value, tuple):
        return tuple(kind_of(each) for each in value)
    if is_dataclass(value) and not isinstance(value, type):
        return (type(value), *(kind_of(getattr(value, each.name)) for each in fields(value)))
    return value


@torch.inference_mode(False)
def _buffer(tensor: Tensor) -> Tensor:
    """Return memory for the like of a tensor, whatever its strides; fits and others may write."""
    return torch.empty(tensor.shape, dtype=tensor.dtype, device=tensor.device)


def _copy(value: Any, buffers: Any) -> None:
    for source, target in zip(tensors_of(value), tensors_of(buffers), strict=True):
        target.copy_(source)
