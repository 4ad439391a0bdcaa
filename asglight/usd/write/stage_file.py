# SPDX-License-Identifier: Apache-2.0
"""Writing lobe tracks as a USD stage."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.threads import beside, one_thread
from asglight.usd.check.lint import lint_stage
from asglight.usd.check.trust import our_own
from asglight.usd.lights import cards
from asglight.usd.options import (
    STAGE_SUFFIXES,
    Representation,
    StageOptions,
    check_stage_options,
)
from asglight.usd.spaces import space_for
from asglight.usd.write import layer, staging
from asglight.usd.write.authoring import TrackAuthor
from asglight.usd.write.checks import check_images_apart, check_target, check_tracks
from asglight.usd.write.keys import KeySource, WrittenKeys
from asglight.usd.write.staging import WriteReport


def write_usd(
    tracks: LobeTracks,
    path: str | Path,
    *,
    representations: Sequence[str] = StageOptions.representations,
    distance: float | None = StageOptions.distance,
    dome_height: int = StageOptions.dome_height,
    meters_per_unit: float = StageOptions.meters_per_unit,
    up_axis: str = StageOptions.up_axis,
    primary_path: str = StageOptions.primary_path,
    colorspace: str = StageOptions.colorspace,
    distant_lights: int = StageOptions.distant_lights,
    card_texture: bool = StageOptions.card_texture,
    keys: KeySource | None = None,
) -> WriteReport:
    """Write tracks as one stage that holds cards, distant lights, a dome, or several as variants.

    The dome's images go to the folder `<stem>_dome` beside the stage, `<stem>.<frame>.exr`, those
    of the cards' fill are `<stem>.fill.<frame>.exr`; tracks that never change have one. The texture
    of the cards is `<stem>.card.exr`. Images of an earlier, longer write stay where they are. A
    package holds its images itself.

    Examples:
        >>> report = asglight.write_usd(tracks, "shot.usdz", up_axis="Z", colorspace="ACEScg")
        >>> report.files[0].name
        'shot.usdz'

    Args:
        tracks: Lobes of F frames; metadata of JSON values, which come back as JSON gives them.
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates, `.usdz` is a package.
        representations: What the stage holds, the one that it opens with first: `cards`, `distant`,
            `dome`, `keys`. One alone needs no variants.
        distance: Of the cards from the origin, in stage units; None for 1,000 m.
        dome_height: Rows of the dome's images; there are twice as many columns.
        meters_per_unit: Length of a stage unit.
        up_axis: Of the stage: `Y` or `Z`. `read_usd` turns the lobes back to +Y up.
        primary_path: The prim that holds the lobes, such as `/World/Lights/Env`; the first of its
            names is the default prim.
        colorspace: Linear space of the stage's colours, by a name that OpenColorIO knows, such as
            `ACEScg`. The tracks are Rec.709; `read_usd` converts back.
        distant_lights: Of an anisotropic lobe in `distant`: 1, or 3 in a row.
        card_texture: Give cards a Gaussian texture, one for all, where that is better.
        keys: What finds the keys, for the representation of that name.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights, an option is out of range, or nothing can be
            written there.
    """
    options = StageOptions(
        representations=tuple(representations),
        distance=distance,
        dome_height=dome_height,
        meters_per_unit=meters_per_unit,
        up_axis=up_axis,
        primary_path=primary_path,
        colorspace=colorspace,
        distant_lights=distant_lights,
        card_texture=card_texture,
    )
    return _write(tracks, Path(path), options, keys)


def _write(
    tracks: LobeTracks, path: Path, options: StageOptions, keys: KeySource | None
) -> WriteReport:
    """Check what `write_usd` is given, and write the stage."""
    check_stage_options(options)
    check_tracks(tracks)
    check_target(path, STAGE_SUFFIXES)
    if (keys is None) == (Representation.KEYS in options.held):
        raise InputError(
            "representations: keys are cut out of the images, which are not given; expected "
            f"others. Add keys to a stage with asglight keys {shown(path)} --reference IMAGES."
            if keys is None
            else "keys: given without their representation; expected keys among them."
        )
    if options.may_show_images:
        check_images_apart(path)
    with one_thread(), staging.staged(path) as place, our_own():
        beside, author, told = _write_files(tracks, options, place, keys)
        findings = [*author.findings, *lint_stage(place, author.checked)]
        if findings:
            raise RuntimeError(f"the stage breaks its own contract: {findings}")
        return staging.move_into_place(place, path, beside, author, told)


def _write_files(
    tracks: LobeTracks, options: StageOptions, place: Path, source: KeySource | None
) -> tuple[list[Path], TrackAuthor, dict[str, Any] | None]:
    """Write the stage at `place`, and its images beside it unless a package holds them.

    Returns:
        The images that go with it, what authored the stage, and what is told of the keys.
    """
    space = space_for(options)
    kinds: list[cards.Kind] = []
    of_all: list[Path] = []
    if Representation.DOME in options.held:
        of_all = staging.dome_images(tracks, place, options.dome_height, space).write()
    if Representation.CARDS in options.held:
        kinds = cards.kinds(tracks.lobes, textured=options.card_texture)
    fill = staging.fill_images(tracks, kinds, place, space)
    card = staging.write_card(kinds, place)
    keys: WrittenKeys | None = None
    told = {name: value for name, value in tracks.metadata.items() if name != "keys"}
    if source is not None:
        keys = staging.write_keys(source, tracks, place, space)
        told["keys"] = keys.document
    tracks = replace(tracks, metadata=told)
    files = [*of_all, *fill.files, *card, *(keys.files if keys else [])]
    root = staging.root_layer(place)
    names = [staging.relative_names(images) for images in (of_all, fill.files, card)]
    images = layer.Images(names[0], names[1], "".join(names[2]))
    with torch.inference_mode(), beside(fill.writing) as filled:
        built, author = layer.build(tracks, options, images, root.name, kinds, keys)
        staging.export(built, root)
        deque(filled(), maxlen=0)
    if root == place:
        return files, author, keys and keys.document
    staging.package(place, [root, *files])
    return [], author, keys and keys.document
