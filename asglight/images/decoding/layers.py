# SPDX-License-Identifier: Apache-2.0
"""Which channels of an OpenEXR file are the image.

A file has parts, a part has named channels, and a name such as `beauty.R` is channel R of layer
`beauty`. Channels without a prefix are the plain image of their part. In a stereo file a part, or a
component of a channel's name, is of one view (OpenEXR's `view` and `multiView` attributes).

The beauty is the plain image of a file of one part; else what renderers call it (`BEAUTY`); else
the only image there is. Where that does not decide, the user is asked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from asglight.errors import InputError
from asglight.images.message import listing, shown
from asglight.images.options import Eye

BEAUTY = frozenset({"c", "ci", "beauty", "rgba", "rgb", "combined", "default", "main"})
"""What renderers call the image of all light, in lower case: Mantra and Karma, RenderMan, many,
Nuke, Blender, Houdini's and Octane's defaults."""

NO_LIGHT = frozenset(
    {"n", "normal", "normals", "p", "pref", "position", "albedo", "depth", "z", "uv", "st", "id"}
    | {"motion", "velocity", "vector", "mask", "matte", "objectid", "materialid", "ao", "denoising"}
)
"""What they call images that hold no light, in lower case: never taken unasked."""

Kind = Literal["rgb", "grey", "xyz", "luminance-chroma"]

_LONG = {"RED": "R", "GREEN": "G", "BLUE": "B"}
_KINDS: tuple[tuple[Kind, tuple[str, str, str]], ...] = (
    ("rgb", ("R", "G", "B")),
    ("luminance-chroma", ("Y", "RY", "BY")),
    ("xyz", ("X", "Y", "Z")),
    ("grey", ("Y", "Y", "Y")),
)
_EYES: dict[str, Eye] = {"left": "left", "l": "left", "right": "right", "r": "right"}


@dataclass(frozen=True)
class Part:
    """One part of a file.

    Attributes:
        name: Empty in a file of one part.
        channels: Names of its channels.
        view: The view it is of, as it states; empty where it states none.
        views: The views that its channels are of, the default one first (`multiView`).
        is_deep: True for deep data.
        is_data: True where it states that it holds no colours.
    """

    name: str
    channels: tuple[str, ...]
    view: str = ""
    views: tuple[str, ...] = ()
    is_deep: bool = False
    is_data: bool = False


@dataclass(frozen=True)
class Layer:
    """Three channels of one part that make an image.

    Attributes:
        part: Index of the part in the file.
        part_name: Name of the part, empty in a file of one part.
        prefix: What precedes `.R`; empty for the plain R, G, B.
        channels: Indices of the three channels within the part; equal for a grey layer.
        kind: What the channels are: R, G, B; Y alone; X, Y, Z; or Y, RY, BY.
        view: The view it is of; empty where the file has none.
        others: Names of the images that were not taken.
        is_data: True where the file or its name says that it holds no light.
    """

    part: int
    part_name: str
    prefix: str
    channels: tuple[int, int, int]
    kind: Kind = "rgb"
    view: str = ""
    others: tuple[str, ...] = ()
    is_data: bool = False

    @property
    def is_colour(self) -> bool:
        """True for three channels; False for luminance alone."""
        return self.kind != "grey"

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names that select this layer, the shortest unambiguous one first."""
        both = ".".join(filter(None, (self.part_name, self.prefix)))
        names = (self.prefix, both, self.part_name)
        without_view = (".".join(w for w in name.split(".") if w != self.view) for name in names)
        return tuple(dict.fromkeys(filter(None, (*names, *without_view))))

    @property
    def label(self) -> str:
        """Return what a user is told: a name, else the plain channels."""
        plain = {"rgb": "R, G, B", "grey": "Y", "xyz": "X, Y, Z", "luminance-chroma": "Y, RY, BY"}
        return self.names[0] if self.names else plain[self.kind]

    @property
    def eye(self) -> Eye | None:
        """Return the eye that the view is of, if it is of one."""
        return _EYES.get(self.view.lower())

    @property
    def short_name(self) -> str:
        """Return the last component of the name that says no view, in lower case."""
        name = self.prefix or self.part_name
        words = [word for word in name.lower().split(".") if word and word != self.view.lower()]
        return words[-1] if words else ""


def choose(path: Path, parts: Sequence[Part], wanted: str | None, eye: Eye | None = None) -> Layer:
    """Return the layer to read.

    Args:
        path: The file, for messages.
        parts: What the file says of its parts.
        wanted: Layer or part asked for, or None.
        eye: Eye asked for, or None.

    Raises:
        InputError: No such layer or eye, no image at all, or several and no wish.
    """
    every = [layer for index, part in enumerate(parts) for layer in _layers_of(index, part)]
    if not every:
        raise _nothing(path, parts)
    layers = every if eye is None else _of_eye(path, every, eye)
    if wanted is not None:
        layers = _named(path, layers, wanted)
    layers = _of_default_view(layers, parts)
    chosen = _only(path, layers) if wanted is not None else _beauty(path, layers)
    if parts[chosen.part].is_deep:
        raise InputError(
            f"{shown(path)}: holds deep data; expected a flat image. Flatten it first."
        )
    others = dict.fromkeys(layer.label for layer in every if layer is not chosen)
    return replace(chosen, others=tuple(others))


def _beauty(path: Path, layers: list[Layer]) -> Layer:
    """Return the image of all light among layers of one view."""
    light = [layer for layer in layers if not layer.is_data]
    if not light:
        names = listing(layer.label for layer in layers)
        raise InputError(
            f"{shown(path)}: its images hold no light by their names or by what it states "
            f"({names}); expected a beauty. If one of them is light, say so with --layer NAME."
        )
    colour = [layer for layer in light if layer.is_colour]
    candidates = colour or light
    named = [layer for layer in candidates if layer.short_name in BEAUTY]
    plain = [layer for layer in candidates if not layer.short_name]
    unprefixed = [layer for layer in candidates if not layer.prefix]
    for found in (plain, named, unprefixed):
        if len(found) == 1 and not (found is unprefixed and len({x.part for x in layers}) > 1):
            return found[0]
        if found and found is not unprefixed:
            return _only(path, found)
    is_alone = sum(layer.is_colour for layer in layers) <= 1 or not colour
    if is_alone:
        return _only(path, candidates)
    raise _ask(path, layers)


def _only(path: Path, layers: list[Layer]) -> Layer:
    """Return the only layer, or the only one that is plain or in colour.

    Raises:
        InputError: There are several.
    """
    colour = [layer for layer in layers if layer.is_colour]
    plain = [layer for layer in colour if not layer.prefix]
    for found in (layers, colour, plain):
        if len(found) == 1:
            return found[0]
    raise _ask(path, layers)


def _ask(path: Path, layers: list[Layer]) -> InputError:
    names = listing(dict.fromkeys(layer.label for layer in layers))
    return InputError(
        f"{shown(path)}: has {len(layers)} layers and none is known as the beauty ({names}); "
        "expected one. Choose it with --layer NAME."
    )


def _named(path: Path, layers: list[Layer], wanted: str) -> list[Layer]:
    """Return the layers that answer to a name: by layer first, then by part; then in any case."""
    exact = [layer for layer in layers if wanted in layer.names[:2]]
    chosen = exact or [layer for layer in layers if wanted in layer.names]
    if not chosen:
        low = wanted.lower()
        chosen = [layer for layer in layers if low in {name.lower() for name in layer.names}]
        if len({layer.names for layer in chosen}) > 1:
            names = listing(layer.label for layer in chosen)
            raise InputError(
                f"{shown(path)}: has {len(chosen)} layers of that name in another case ({names}); "
                "expected one of them. Write --layer as it is written there."
            )
    if not chosen:
        names = listing(dict.fromkeys(name for layer in layers for name in layer.names[:1]))
        raise InputError(
            f"{shown(path)}: has no layer {shown(wanted)}; expected one of its layers "
            f"({names or 'none, only plain R, G, B'}). Check --layer."
        )
    return chosen


def _of_eye(path: Path, layers: list[Layer], eye: Eye) -> list[Layer]:
    """Return the layers of an eye; all of a file that is of no eye, whose halves may be."""
    if not any(layer.eye for layer in layers):
        return layers
    found = [layer for layer in layers if layer.eye == eye]
    if not found:
        views = listing(dict.fromkeys(layer.view for layer in layers if layer.view))
        raise InputError(
            f"{shown(path)}: has no {eye} eye; expected one of its views ({views}). Check --eye."
        )
    return found


def _of_default_view(layers: list[Layer], parts: Sequence[Part]) -> list[Layer]:
    views = list(dict.fromkeys(layer.view for layer in layers if layer.view))
    if len(views) < 2:
        return layers
    stated = next((part.views[0] for part in parts if part.views), views[0])
    default = stated if stated in views else views[0]
    return [layer for layer in layers if layer.view in ("", default)]


def _nothing(path: Path, parts: Sequence[Part]) -> InputError:
    found = listing(name for part in parts for name in part.channels)
    return InputError(
        f"{shown(path)}: has channels {found}; expected R, G, B; X, Y, Z; Y, RY, BY; or Y. "
        "Is it a depth or a matte? Save the image as R, G, B."
    )


def _layers_of(index: int, part: Part) -> list[Layer]:
    by_prefix: dict[str, dict[str, int]] = {}
    for place, name in enumerate(part.channels):
        prefix, _, channel = name.rpartition(".")
        channel = channel.upper()
        by_prefix.setdefault(prefix, {})[_LONG.get(channel, channel)] = place
    layers = []
    for prefix, group in by_prefix.items():
        found = next((one for one in _KINDS if group.keys() >= set(one[1])), None)
        if found is None:
            continue
        kind, names = found
        first, second, third = (group[name] for name in names)
        own = "" if prefix == part.name else prefix  # Blender repeats the part's name
        layer = Layer(index, part.name, own, (first, second, third), kind, _view_of(part, prefix))
        word = layer.short_name
        is_data = part.is_data or word in NO_LIGHT or word.startswith("crypto")
        # Vectors have X, Y and Z; an image of those is one by its name, or the plain one.
        is_data = is_data or (kind == "xyz" and bool(word) and word not in BEAUTY)
        layers.append(replace(layer, is_data=is_data))
    return layers


def _view_of(part: Part, prefix: str) -> str:
    """Return the view of a layer: of its part, of its name, or the default one."""
    if part.view:
        return part.view
    words = prefix.split(".")
    for view in part.views[1:]:
        if view in words:
            return view
    if part.views:
        return part.views[0]
    # Without a statement: parts and layers that are named so, as `rgba.left` and `rgba.right`.
    names = [*words, *part.name.split(".")]
    return next((word for word in reversed(names) if word.lower() in ("left", "right")), "")
