# SPDX-License-Identifier: GPL-3.0-or-later
"""What a layer over a stage may not be written to; needs `pxr`, not `bpy`."""

from pathlib import Path

from pxr import Usd, UsdUtils

from .image_files import is_packed

IMAGES = "_dome"
"""What follows a stage's name in that of the folder of its images, as asglight writes them."""


def refuse_what_is_used(stage: Usd.Stage, source: Path, target: Path) -> None:
    """Refuse a target that would replace what the stage is made of, or take its images for its own.

    Args:
        stage: Opened from the source.
        source: Its file.
        target: The layer that is to be written.

    Raises:
        ValueError: The target is a layer of the stage, or the folder of images that goes with its
            name holds images of the stage.
    """
    layers, images, _ = UsdUtils.ComputeAllDependencies(str(source))
    if target.exists():
        for layer in (*stage.GetUsedLayers(), *layers):
            below = _file_of(layer.realPath)
            if below is not None and target.samefile(below):
                raise ValueError(f"lies over {target.name}; expected another name for the layer")
    folder = target.with_name(f"{target.stem}{IMAGES}")
    if folder.is_dir():
        used = {parent for image in images if (file := _file_of(image)) for parent in file.parents}
        if any(folder.samefile(one) for one in used):
            raise ValueError(
                f"has images in {folder.name}, which goes with {target.name}; expected another "
                "name for the layer"
            )


def _file_of(path: str) -> Path | None:
    """Return the file of a layer or an image, or the package that holds it; None without one."""
    file = Path(path[: path.index("[")] if is_packed(path) else path)
    return file if path and file.exists() else None
