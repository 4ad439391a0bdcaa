# SPDX-License-Identifier: Apache-2.0
"""A device apart from the host that needs none: tensors on it say so, and keep their data here.

An operation on tensors of which some are there and some are here is an error, as it is on a GPU. So
a whole fit shows where something was left behind, without a GPU. Its name is that of a device that
torch knows and never has to wake.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

DEVICE = torch.device("meta:1")
"""Of a number of its own: constants are kept by device, and those of "meta" have no data."""

_COPIES = ("aten::_to_copy", "aten::copy_", "aten::_copy_from")
"""What goes from one device to the other."""

_INDEXED = ("aten::index", "aten::index_put", "aten::index_put_")
"""What takes indices from the host, as a GPU does."""


class Elsewhere(Tensor):
    """A tensor on the device; `is_cuda`, for that is what decides how steps are taken."""

    is_cuda = True  # type: ignore[assignment]
    __torch_function__ = torch._C._disabled_torch_function_impl  # type: ignore[assignment]
    own: Tensor

    @staticmethod
    def __new__(cls, own: Tensor) -> "Elsewhere":
        made = Tensor._make_wrapper_subclass(
            cls,
            own.shape,
            strides=own.stride(),
            storage_offset=own.storage_offset(),
            dtype=own.dtype,
            device=DEVICE,
        )
        made.own = own
        return made

    def __getitem__(self, index: Any) -> Tensor:
        # torch would make indices of numbers on this device, where it knows no data
        parts = index if isinstance(index, tuple) else (index,)
        found = tuple(torch.tensor(each) if isinstance(each, list) else each for each in parts)
        return Tensor.__getitem__(self, found)

    def __matmul__(self, other: Tensor) -> Tensor:
        # torch would make it of products of matrices, and change their shape in place
        return _run(torch.ops.aten.matmul.default, (self, other), {})

    # what Python asks a tensor for, torch would have to wake the device for
    def tolist(self) -> list:
        return self.own.tolist()

    def new_tensor(self, data: Any, **kwargs: Any) -> Tensor:
        return self.own.new_tensor(data, **kwargs).to(DEVICE)

    def item(self) -> Any:
        return self.own.item()

    def __bool__(self) -> bool:
        return bool(self.own)

    def __int__(self) -> int:
        return int(self.own)

    def __float__(self) -> float:
        return float(self.own)

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        raise AssertionError(f"{func}: outside of `watched`")


class _Watching(TorchDispatchMode):
    """Sees every operation, those too that make tensors of numbers."""

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        with self:  # in inference mode, operations that are made of others come as they are
            found = func.decompose(*args, **kwargs)
        return _run(func, args, kwargs) if found is NotImplemented else found


def _run(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """Do an operation on the data, and say where the results are."""
    given = [each for each in tree_flatten((args, kwargs))[0] if isinstance(each, Tensor)]
    there = [each for each in given if isinstance(each, Elsewhere)]
    name = func._schema.name
    if there and name not in _COPIES:
        # a GPU takes a single number from the host, and nothing more
        needed = tree_flatten((args[0], args[2:]))[0] if name in _INDEXED else given
        left = [each for each in needed if isinstance(each, Tensor) and each.ndim > 0]
        left = [each for each in left if not isinstance(each, Elsewhere)]
        assert not left, f"{name}: a tensor {tuple(left[0].shape)} was left on the host"
    device = kwargs.get("device")
    device = None if device is None else torch.device(device)
    on_host = {**kwargs, "device": torch.device("cpu")} if device is not None else kwargs
    found = func(*tree_map(_data, args), **tree_map(_data, on_host))
    goes = bool(there) if device is None else device.type == DEVICE.type
    if name == "aten::copy_":
        return args[0]
    known = {id(each.own): each for each in there}

    def placed(value: Any) -> Any:
        if not isinstance(value, Tensor) or not goes:
            return value
        return known.get(id(value)) if id(value) in known else Elsewhere(value)

    return tree_map(placed, found)


def _data(value: Any) -> Any:
    return value.own if isinstance(value, Elsewhere) else value


@contextmanager
def watched() -> Iterator[torch.device]:
    """Let there be the device; what is computed within is on it where it was asked for."""
    with pytest.MonkeyPatch.context() as patched, _Watching():
        for name in ("tensor", "as_tensor"):  # which no mode sees
            patched.setattr(torch, name, partial(_made, getattr(torch, name)))
        # whose tensors know nothing of views, which those that say where they are go by
        patched.setattr(torch, "inference_mode", lambda mode=True: torch.set_grad_enabled(not mode))
        yield DEVICE


def _made(make: Callable[..., Tensor], data: Any, *, device: Any = None, **kwargs: Any) -> Tensor:
    """Make a tensor of numbers here, and bring it there."""
    if device is None or isinstance(data, Tensor):
        return make(data, **kwargs) if device is None else data.to(device, **kwargs)
    return make(data, **kwargs).to(device)
