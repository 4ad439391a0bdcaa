# SPDX-License-Identifier: Apache-2.0
"""Files written beside their target, checked there, and only then renamed into place.

Everything goes into a hidden folder beside the target: the stage, and the dome's images in
`<stem>_dome`. The images are renamed one by one, the stage last. A write that fails before leaves
every file as it was. One that is killed between two renames leaves the old stage with some images
of the new one; whenever it ends, the stage that stands at the target finds all its images.
"""

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from pxr import Sdf, Tf

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd.faults import reason
from asglight.usd.lights import card_texture, cards, dome
from asglight.usd.options import image_folder
from asglight.usd.spaces import Space
from asglight.usd.write.authoring import TrackAuthor
from asglight.usd.write.keys import KeySource, WrittenKeys


@dataclass(frozen=True)
class WriteReport:
    """What was written.

    Attributes:
        files: The stage, then the dome's images.
        bytes: Their size together.
        samples_written: Time samples in the stage.
        samples_between: How many of them lie between frames.
        samples_left_out: Samples at frames that interpolation or a constant default reproduces.
        keys: What is told of the keys, as JSON values; None where the stage has none.
    """

    files: tuple[Path, ...]
    bytes: int
    samples_written: int
    samples_between: int
    samples_left_out: int
    keys: dict[str, Any] | None = None


@contextmanager
def staged(path: Path) -> Iterator[Path]:
    """Give a place for a stage in a hidden folder beside its target, removed at the end.

    Args:
        path: The target.

    Yields:
        Where to write the stage first.

    Raises:
        InputError: Something within cannot be written.
    """
    try:
        # Beside the target, hence on its file system, where a rename is atomic.
        with tempfile.TemporaryDirectory(
            prefix=".asglight-", dir=path.parent, ignore_cleanup_errors=True
        ) as folder:
            yield Path(folder) / path.name
    except (OSError, Tf.ErrorException) as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({reason(error)}); expected a folder with room and "
            "the permission to write. Check the output path."
        ) from error


def dome_images(
    tracks: LobeTracks, place: Path, height: int, space: Space, part: str = ""
) -> dome.Textures:
    """Return a dome's images beside a staged stage, and make their folder.

    Args:
        tracks: Lobes of all frames.
        place: The staged stage.
        height: Rows; there are twice as many columns.
        space: Of the stage's colours.
        part: Ends the names' stem, where not all lobes are shown.
    """
    folder = image_folder(place)
    folder.mkdir(exist_ok=True)
    images = dome.textures(tracks, folder, f"{place.stem}{part}", height, space)
    return replace(images, writing=[_named_as_asked(place)(one) for one in images.writing])


@contextmanager
def _named_as_asked(place: Path) -> Iterator[None]:
    """Name the file that was asked for, and not that of the hidden folder, in what is raised."""
    try:
        yield
    except InputError as error:
        raise InputError(
            str(error).replace(shown(place.parent), shown(place.parent.parent))
        ) from error


def fill_images(
    tracks: LobeTracks, kinds: Sequence[cards.Kind], place: Path, space: Space
) -> dome.Textures:
    """Return the images of the lobes that are fill, `<stem>.fill.<frame>.exr`; none for none."""
    if cards.Kind.FILL not in kinds:
        return dome.Textures([], [])
    broad = torch.tensor([kind is cards.Kind.FILL for kind in kinds])
    names = tuple(name for name, one in zip(tracks.names, broad, strict=True) if one)
    chosen = replace(tracks, lobes=tracks.lobes.to("cpu").select(broad), names=names)
    return dome_images(chosen, place, cards.FILL_HEIGHT, space, ".fill")


def write_card(kinds: Sequence[cards.Kind], place: Path) -> list[Path]:
    """Write the texture of the cards, `<stem>.card.exr`, if a card has one.

    Raises:
        InputError: The file cannot be written.
    """
    if cards.Kind.TEXTURED not in kinds:
        return []
    path = image_folder(place) / f"{place.stem}.card.exr"
    path.parent.mkdir(exist_ok=True)
    with _named_as_asked(place):
        card_texture.write_texture(path)
    return [path]


def write_keys(source: KeySource, tracks: LobeTracks, place: Path, space: Space) -> WrittenKeys:
    """Find the keys of a shot, and write the images of their rest, `<stem>.rest.<frame>.exr`.

    Raises:
        InputError: An image cannot be read or written.
    """
    folder = image_folder(place)
    folder.mkdir(exist_ok=True)
    with _named_as_asked(place):
        return source.write(tracks, folder, place.stem, space)


def relative_names(textures: Sequence[Path]) -> list[str]:
    """Return how a stage refers to its dome's images, wherever the two lie together."""
    return [f"./{texture.parent.name}/{texture.name}" for texture in textures]


def export(layer: Sdf.Layer, place: Path) -> None:
    """Write a layer in the format that its place's extension names.

    Raises:
        OSError: USD could not.
    """
    kind = "usda" if place.suffix.lower() == ".usda" else "usdc"
    if not layer.Export(str(place), args={"format": kind}):
        raise OSError(None, "USD could not save the layer")


def _to_disk(path: Path) -> None:
    """Wait until a file, or what files a folder has, is on disk: power may fail at any time."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def root_layer(place: Path) -> Path:
    """Return where the layer of a stage is written: a package's is a crate beside it."""
    return place.with_suffix(".usdc") if place.suffix.lower() == ".usdz" else place


def package(place: Path, files: Sequence[Path]) -> None:
    """Put a stage and its images into one usdz file.

    Args:
        place: The package.
        files: The stage's layer first, as a package asks for; all in or below one folder.
    """
    with Sdf.ZipFileWriter.CreateNew(str(place)) as writer:
        for file in files:
            writer.AddFile(str(file), file.relative_to(files[0].parent).as_posix())


def move_into_place(
    place: Path,
    path: Path,
    textures: Sequence[Path],
    author: TrackAuthor,
    keys: dict[str, Any] | None = None,
) -> WriteReport:
    """Rename the dome's images and then the stage to where they belong.

    Args:
        place: The staged stage.
        path: The target.
        textures: Staged images.
        author: What counted the samples.
        keys: What is told of the keys.
    """
    folder = image_folder(path)
    if textures:
        folder.mkdir(exist_ok=True)
    images = [folder / texture.name for texture in textures]
    for file in (*textures, place):
        _to_disk(file)
    for texture, image in zip(textures, images, strict=True):
        os.replace(texture, image)
    os.replace(place, path)
    for place_of_names in {folder, path.parent} if textures else {path.parent}:
        _to_disk(place_of_names)
    files = (path, *images)
    size = sum(file.stat().st_size for file in files)
    return WriteReport(files, size, author.written, author.between, author.left_out, keys)
