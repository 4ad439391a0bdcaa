# SPDX-License-Identifier: Apache-2.0
"""Stages that several tests look at: written once, and copied into the folder of each."""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import torch
from pxr import Usd
from usd_tracks import beginning, contents, write_every

from asglight.lobes import LobeTracks
from asglight.usd import WriteReport, write_usd

_KEPT: dict[tuple[Any, ...], tuple[WriteReport, dict[str, bytes]]] = {}


def put_every(
    tracks: LobeTracks, path: Path, representation: str = "cards", **options: Any
) -> WriteReport:
    """Do what `write_every` does where no stage is; the same stage is written once."""
    return _put(write_every, tracks, path, representation=representation, **options)


def put(tracks: LobeTracks, path: Path, **options: Any) -> WriteReport:
    """Do what `write_usd` does where no stage is; the same stage is written once."""
    return _put(write_usd, tracks, path, **options)


def _put(
    write: Callable[..., WriteReport], tracks: LobeTracks, path: Path, **options: Any
) -> WriteReport:
    assert not path.exists()
    case = write.__name__, _key(tracks), path.name, repr(sorted(options.items()))
    if case not in _KEPT:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            report = write(tracks, folder / path.name, **options)
            files = tuple(file.relative_to(folder) for file in report.files)
            _KEPT[case] = replace(report, files=files), contents(folder)
    report, made = _KEPT[case]
    for place, data in made.items():
        (path.parent / place).parent.mkdir(exist_ok=True)
        (path.parent / place).write_bytes(data)
    return replace(report, files=tuple(path.parent / file for file in report.files))


def calm(
    make: Callable[..., LobeTracks], frames: Sequence[int], *arguments: Any, **options: Any
) -> LobeTracks:
    """Return the first frames of a longer shot, whose lights need few samples between frames.

    Args:
        make: `moving` or `of_every_kind`.
        frames: Its frames.
        arguments: Of `make`, after the frames.
        options: Of `make`.
    """
    longer = (*frames, *range(frames[-1] + 1, frames[-1] + 65))
    return beginning(make(longer, *arguments, **options), len(frames))


def selected(path: Path, representation: str, rig: str = "/AsgRig") -> Usd.Stage:
    """Open a stage of several representations in one of them; the file stays as it is."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    variants = stage.GetPrimAtPath(rig).GetVariantSet("representation")
    assert representation in variants.GetVariantNames()
    variants.SetVariantSelection(str(representation))
    return stage


def _key(tracks: LobeTracks) -> tuple[Any, ...]:
    values = []
    for holder in (tracks, tracks.lobes):
        for field in fields(holder):
            value = getattr(holder, field.name)
            if isinstance(value, torch.Tensor):
                values.append((str(value.dtype), value.shape, value.contiguous().numpy().tobytes()))
            elif holder is not tracks or field.name != "lobes":
                values.append(repr(value))
    return tuple(values)
