# SPDX-License-Identifier: Apache-2.0
"""Keys and the rest: what a stage is told of them, and how they are authored.

A key is stored as the lobe of its card (AsgLobeAPI, as those of the fit) and shines as that card or
as a distant light. The rest is a dome with an image a frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from asglight.lobes import LobeTracks
from asglight.lobes.data import Lobes
from asglight.usd.options import KeyLights
from asglight.usd.spaces import Space


@dataclass(frozen=True)
class WrittenKeys:
    """The keys of a shot, whose images are written.

    Attributes:
        names: Of the keys.  K
        lobes: Those of their cards, in Rec.709 and with +Y up; None where there is no key.
            [F, K, .]
        rest: Images of the rest, one a frame.
        textures: Of each key an image a frame, of which some may be the same; empty without.
        lights: What a key shines as.
        document: What is told of them: shares, sizes, colours. JSON values.
        display_names: What a person calls them, by name, where that is something else.
    """

    names: tuple[str, ...]
    lobes: Lobes | None
    rest: tuple[Path, ...]
    textures: tuple[tuple[Path, ...], ...]
    lights: KeyLights
    document: dict[str, Any]
    display_names: Mapping[str, str] = field(default_factory=dict)

    @property
    def files(self) -> list[Path]:
        """Return the images, each once."""
        return list(dict.fromkeys([*self.rest, *(path for own in self.textures for path in own)]))


class KeySource(Protocol):
    """What finds keys and writes their images."""

    def write(self, tracks: LobeTracks, folder: Path, stem: str, space: Space) -> WrittenKeys:
        """Find the keys of a shot, and write images to a folder under names that begin so."""
        ...
