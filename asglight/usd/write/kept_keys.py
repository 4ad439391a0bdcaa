# SPDX-License-Identifier: Apache-2.0
"""The keys that a stage has, for one that is written anew: nothing is cut, images are copied."""

import itertools
import shutil
from pathlib import Path

from pxr import Usd

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.check.lint import texture_findings
from asglight.usd.read.keys import held_keys
from asglight.usd.read.placement import turn_words
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space
from asglight.usd.stage import image_file, lobe_prims, open_rig, readable, show
from asglight.usd.write.keys import WrittenKeys


class KeptKeys:
    """The keys of a stage as what writes them once more (`keys.KeySource`)."""

    def __init__(self, path: str | Path) -> None:
        """Read the keys; what another program changed of them becomes what they are.

        Args:
            path: A stage that has keys.

        Raises:
            InputError: Its rest was changed, which the images that are copied do not show; or a key
                has pixels that are none of its lamp.
        """
        found = held_keys(path)
        assert found is not None
        self._keys, self._lights, self._textures = found.keys, found.lights, found.textures
        _check_textures(path)
        rest = found.keys.rest
        changes = [*rest.changes, *turn_words(rest.turns)]
        if changes:
            raise InputError(
                f"{shown(path)}: the rest was changed ({changes[0]}), which its images do not "
                "show; expected it as it was written. Undo that, or cut the keys anew: asglight "
                f"keys {shown(path)} --reference IMAGES."
            )

    def write(self, tracks: LobeTracks, folder: Path, stem: str, space: Space) -> WrittenKeys:
        """Copy the images of rest and textures; arguments as of `keys.KeySource`."""
        written = self.planned(tracks, folder, stem)
        rest = [self._keys.rest.image(place) for place in range(len(written.rest))]
        sources = [*rest, *(path for own in self._textures for path in own)]
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


def _check_textures(path: str | Path) -> None:
    """Check that pixels of lamps leave the flux of their keys as it is."""
    stage, rig = open_rig(path)
    stage.SetEditTarget(stage.GetSessionLayer())
    show(rig, Representation.KEYS)
    with readable(path):
        for key in lobe_prims(rig, schema.KEYS):
            attribute = key.GetAttribute(schema.TEXTURE)
            times = attribute.GetTimeSamples() if attribute else []
            first: dict[str, Usd.TimeCode] = {}  # where each image is as it was made
            for code in map(Usd.TimeCode, times):
                first.setdefault(str(attribute.Get(code)), code)
            findings = (texture_findings(attribute, code) for code in first.values())
            for finding in itertools.chain.from_iterable(findings):
                raise InputError(
                    f"{shown(path)}: the texture of {key.GetName()} {finding}. Undo that, or cut "
                    f"the keys anew: asglight keys {shown(path)} --reference IMAGES."
                )
