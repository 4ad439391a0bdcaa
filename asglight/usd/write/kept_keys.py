# SPDX-License-Identifier: Apache-2.0
"""The keys that a stage has, for one that is written anew: nothing is cut, images are copied."""

import shutil
from pathlib import Path

from pxr import Usd

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.read.keys import Keys, read_keys
from asglight.usd.read.placement import turn_words
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space
from asglight.usd.stage import image_file, key_lights, lobe_prims, open_rig, show
from asglight.usd.write.keys import WrittenKeys


class KeptKeys:
    """The keys of a stage as what writes them once more (`keys.KeySource`)."""

    def __init__(self, path: str | Path) -> None:
        """Read the keys; what another program changed of them becomes what they are.

        Args:
            path: A stage that has keys.

        Raises:
            InputError: Its rest was changed, which the images that are copied do not show.
        """
        found = read_keys(path)
        assert found is not None
        self._keys: Keys = found
        changes = [*found.rest.changes, *turn_words(found.rest.turns)]
        if changes:
            raise InputError(
                f"{shown(path)}: the rest was changed ({changes[0]}), which its images do not "
                "show; expected it as it was written. Undo that, or cut the keys anew: asglight "
                f"keys {shown(path)} --reference IMAGES."
            )
        stage, rig = open_rig(path)
        stage.SetEditTarget(stage.GetSessionLayer())
        show(rig, Representation.KEYS)
        prims = lobe_prims(rig, schema.KEYS)
        self._lights = key_lights(prims)
        self._textures = [_textures(prim, found.times) for prim in prims]

    def write(self, tracks: LobeTracks, folder: Path, stem: str, space: Space) -> WrittenKeys:
        """Copy the images of rest and textures; arguments as of `keys.KeySource`."""
        written = self.planned(tracks, folder, stem)
        sources = [*self._keys.rest.images, *(path for own in self._textures for path in own)]
        targets = [*written.rest, *(path for own in written.textures for path in own)]
        for target, source in dict(zip(targets, sources, strict=True)).items():
            with image_file(source) as image:
                shutil.copyfile(image, target)
        return written

    def planned(self, tracks: LobeTracks, folder: Path, stem: str) -> WrittenKeys:
        """Return what `write` writes; nothing is copied."""
        keys, frames = self._keys.tracks, self._keys.times
        names = () if keys is None else keys.names
        rest = tuple(folder / f"{stem}.rest.{frame:04d}.exr" for frame in frames)
        textures = []
        for name, own in zip(names, self._textures, strict=True):
            if not own:
                textures.append(())
                continue
            first: dict[str, int] = {}  # frames that share an image share its copy
            for frame, image in zip(frames, own, strict=True):
                first.setdefault(image, frame)
            textures.append(
                tuple(folder / f"{stem}.{name}.{first[image]:04d}.exr" for image in own)
            )
        lobes = None if keys is None else keys.lobes
        document = tracks.metadata.get("keys", {})
        called = {} if keys is None else keys.display_names
        return WrittenKeys(names, lobes, rest, tuple(textures), self._lights, document, called)


def _textures(prim: Usd.Prim, frames: tuple[int, ...]) -> tuple[str, ...]:
    """Return the image of a key at each frame, as USD resolves it; empty without."""
    attribute = prim.GetAttribute(schema.TEXTURE)
    assets = [attribute.Get(frame) if attribute else None for frame in frames]
    found = tuple(getattr(one, "resolvedPath", "") for one in assets)
    return found if all(found) else ()
