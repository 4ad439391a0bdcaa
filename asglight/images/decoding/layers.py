# SPDX-License-Identifier: Apache-2.0
"""Which channels of an OpenEXR file are the image.

A file has parts, a part has named channels, and a name such as `beauty.R` is channel R of layer
`beauty`. Channels without a prefix are the plain image. A colour layer has R, G and B; a grey one
has only luminance, Y.
"""

from dataclasses import dataclass
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import listing, shown


@dataclass(frozen=True)
class Layer:
    """Three channels of one part that make an image.

    Attributes:
        part: Index of the part in the file.
        part_name: Name of the part, empty in a file of one part.
        prefix: What precedes `.R`; empty for the plain R, G, B.
        channels: Indices of red, green and blue within the part; equal for a grey layer.
    """

    part: int
    part_name: str
    prefix: str
    channels: tuple[int, int, int]

    @property
    def is_colour(self) -> bool:
        """True for R, G, B; False for luminance alone."""
        return len(set(self.channels)) == 3

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names that select this layer, the shortest unambiguous one first."""
        both = ".".join(filter(None, (self.part_name, self.prefix)))
        return tuple(dict.fromkeys(filter(None, (self.prefix, both, self.part_name))))


def choose(path: Path, parts: list[tuple[str, tuple[str, ...]]], wanted: str | None) -> Layer:
    """Return the layer to read.

    Without a wish: the plain R, G, B of the first part that has them, else the only colour layer,
    else the only grey one.

    Args:
        path: The file, for messages.
        parts: Name and channel names of every part.
        wanted: Layer or part asked for, or None.

    Raises:
        InputError: No such layer, no image at all, or several and no wish.
    """
    layers = [layer for index, part in enumerate(parts) for layer in _layers_of(index, *part)]
    if wanted is not None:
        layers = _named(path, layers, wanted)
    if not layers:
        found = listing(name for _, channels in parts for name in channels)
        raise InputError(
            f"{shown(path)}: has channels {found}; expected R, G, B or Y. "
            "Is it a depth, matte, or luminance-chroma (Y, RY, BY) file? Save it as R, G, B."
        )
    colour = [layer for layer in layers if layer.is_colour]
    plain = [layer for layer in colour if not layer.prefix]
    if plain:
        return plain[0]
    candidates = colour or layers
    if len(candidates) > 1:
        names = listing(layer.names[0] if layer.names else "Y" for layer in candidates)
        raise InputError(
            f"{shown(path)}: has {len(candidates)} layers and none is plain R, G, B ({names}); "
            "expected one. Choose it with --layer NAME."
        )
    return candidates[0]


def _named(path: Path, layers: list[Layer], wanted: str) -> list[Layer]:
    """Return the layers that answer to a name: by layer first, then by part."""
    exact = [layer for layer in layers if wanted in layer.names[:2]]
    chosen = exact or [layer for layer in layers if wanted in layer.names]
    if not chosen:
        names = listing(dict.fromkeys(name for layer in layers for name in layer.names[:1]))
        raise InputError(
            f"{shown(path)}: has no layer {shown(wanted)}; expected one of its layers "
            f"({names or 'none, only plain R, G, B'}). Check --layer."
        )
    return chosen


def _layers_of(part: int, part_name: str, channels: tuple[str, ...]) -> list[Layer]:
    by_prefix: dict[str, dict[str, int]] = {}
    for index, name in enumerate(channels):
        prefix, _, channel = name.rpartition(".")
        by_prefix.setdefault(prefix, {})[channel.upper()] = index
    layers = []
    for prefix, group in by_prefix.items():
        if {"R", "G", "B"} <= group.keys():
            layers.append(Layer(part, part_name, prefix, (group["R"], group["G"], group["B"])))
        elif "Y" in group and not {"RY", "BY"} & group.keys():
            grey = group["Y"]
            layers.append(Layer(part, part_name, prefix, (grey, grey, grey)))
    return layers
