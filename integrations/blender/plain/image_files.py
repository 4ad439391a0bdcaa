# SPDX-License-Identifier: GPL-3.0-or-later
"""Images of a dome as what Blender calls a sequence: names that differ in their last number."""

import re
import shutil
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_NUMBERED = re.compile(r"(?P<head>.*?)(?P<number>\d+)(?P<tail>\D*)$")


@dataclass(frozen=True)
class ImageSequence:
    """Images over time.

    Attributes:
        first: The file of the first time.
        numbers: That of each time's file; none where there is one image.
    """

    first: Path
    numbers: tuple[int, ...]


def image_sequence(images: Sequence[str], folder: Path) -> ImageSequence:
    """Return images as a sequence; those that are none, or lie in a package, are copied.

    Args:
        images: One a time, as USD resolves them: a path, or `package.usdz[path]`.
        folder: Where copies go; it is made where there are any.

    Raises:
        OSError: An image cannot be read or its copy not be written.
    """
    distinct = list(dict.fromkeys(images))
    named = [Path(inner_name(image)) for image in distinct]
    if any(is_packed(image) for image in distinct):
        names = [path.name for path in named]
        if numbers_of([Path(name) for name in names]) is None:
            names = _counted(named)
    elif len(named) == 1 or numbers_of(named) is not None:
        names = []
    else:
        names = _counted(named)
    if names:
        folder.mkdir(parents=True, exist_ok=True)
        for image, name in zip(distinct, names, strict=True):
            _copy(image, folder / name)
        named = [folder / name for name in names]
    if len(named) == 1:
        return ImageSequence(named[0], ())
    numbers = dict(zip(distinct, numbers_of(named) or (), strict=True))
    return ImageSequence(named[0], tuple(numbers[image] for image in images))


def numbers_of(paths: Sequence[Path]) -> tuple[int, ...] | None:
    """Return the last number in each name, or None where names differ in anything else."""
    found = [_NUMBERED.fullmatch(path.name) for path in paths]
    parts = [match for match in found if match]
    alike = {
        (path.parent, match["head"], len(match["number"]), match["tail"])
        for path, match in zip(paths, parts, strict=False)
    }
    if len(parts) < len(paths) or len(alike) > 1:
        return None
    return tuple(int(match["number"]) for match in parts)


def is_packed(image: str) -> bool:
    """Tell whether an image lies in a package."""
    return image.endswith("]") and "[" in image


def inner_name(image: str) -> str:
    """Return an image's path, in its package if it is in one."""
    return image[image.index("[") + 1 : -1] if is_packed(image) else image


def _counted(paths: Sequence[Path]) -> list[str]:
    return [f"image.{index:04d}{path.suffix}" for index, path in enumerate(paths, start=1)]


def _copy(image: str, target: Path) -> None:
    """Copy an image beside its target, and rename it."""
    beside = target.with_name(f".{target.name}.part")
    try:
        with beside.open("wb") as written:
            if is_packed(image):
                package = zipfile.ZipFile(image[: image.index("[")])
                with package, package.open(inner_name(image)) as read:
                    shutil.copyfileobj(read, written)
            else:
                with open(image, "rb") as read:
                    shutil.copyfileobj(read, written)
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
