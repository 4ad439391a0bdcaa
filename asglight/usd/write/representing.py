# SPDX-License-Identifier: Apache-2.0
"""More representations for a stage that was written with fewer."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pxr import Sdf

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd.options import Representation, StageOptions
from asglight.usd.read.read_options import read_options, shown_kinds
from asglight.usd.read.tracks import read_usd
from asglight.usd.stage import open_rig
from asglight.usd.write import layer
from asglight.usd.write.kept_keys import KeptKeys
from asglight.usd.write.stage_file import write_usd
from asglight.usd.write.staging import WriteReport


def add_representations(
    path: str | Path, added: Sequence[str], target: str | Path | None = None
) -> WriteReport:
    """Write a stage anew, with the representations that it holds and more.

    It opens with the one that it opened with. What another program changed of its lights becomes
    what the lobes are, as `read_usd` reads them.

    Args:
        path: The stage.
        added: Representations; those that it holds already stay.
        target: Where to write; None for the stage itself.

    Raises:
        InputError: There is no such stage, or it cannot be written; or it would be written over and
            holds what another program added, which asglight would not write.
    """
    tracks, options = read_usd(path), read_options(path)
    names = dict.fromkeys([*options.representations, *map(str, added)])
    keys = KeptKeys(path) if Representation.KEYS in options.held else None
    if target is None:
        _check_own(Path(path), tracks, options, keys)
    options = replace(options, representations=tuple(names))
    return write_usd(tracks, path if target is None else target, **vars(options), keys=keys)


def _check_own(
    path: Path, tracks: LobeTracks, options: StageOptions, keys: KeptKeys | None
) -> None:
    """Refuse to write over a stage whose own layer says more than asglight wrote."""
    stage, rig = open_rig(path)
    stage.SetEditTarget(stage.GetSessionLayer())
    root = stage.GetRootLayer()
    images = layer.Images(["./dome.exr"], ["./fill.exr"], "./card.exr")  # paths tell nothing
    held = None if keys is None else keys.planned(tracks, Path("images"), path.stem)
    built, _ = layer.build(tracks, options, images, path.name, shown_kinds(rig), held)
    foreign = _paths(root) - _paths(built)
    if foreign or root.subLayerPaths:
        found = min(map(str, foreign)) if foreign else root.subLayerPaths[0]
        raise InputError(
            f"{shown(path)}: holds {shown(found)}, which asglight did not write; expected a stage "
            "as it was written. Write another stage with -o STAGE."
        )


def _paths(of: Sdf.Layer) -> set[Sdf.Path]:
    """Return the paths of everything that a layer says."""
    found: set[Sdf.Path] = set()
    of.Traverse(Sdf.Path.absoluteRootPath, found.add)
    return found
