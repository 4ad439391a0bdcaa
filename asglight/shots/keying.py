# SPDX-License-Identifier: Apache-2.0
"""Keys of a shot: its images are read twice, to find its lamps and to cut them.

First every frame is searched for lamps, which are followed and chosen over the whole shot. Then
every frame is cut: its rest is written at once, so that no more than a frame is in memory, and what
its keys take becomes lobes (`asglight.keys.lobes`).

Symbols: F frames, K keys.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor

from asglight.images import LatlongImage, Sequence
from asglight.keys import following, report, texture
from asglight.keys.cut import ROWS, FrameCut, Wanted, frame_cut, light_of, parts
from asglight.keys.following import Sighting, Track
from asglight.keys.lobes import as_lobes
from asglight.keys.rectangles import Card
from asglight.keys.report import KeyFrame
from asglight.keys.sighting import sightings
from asglight.keys.spots import Grid, Mask, Places
from asglight.lobes import LobeTracks, asg
from asglight.lobes.data import Lobes, first_unused
from asglight.shots.events import Keyed, OnProgress
from asglight.shots.keyed.images import Target
from asglight.sphere import latlong
from asglight.sphere.turns import turn_between
from asglight.threads import one_thread
from asglight.usd.options import KeyOptions
from asglight.usd.spaces import Space
from asglight.usd.write.keys import WrittenKeys

_Item = TypeVar("_Item")


class Follow(Protocol):
    """Shows how far some work is."""

    def __call__(self, items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        """Pass items on and show how many have been."""
        ...


def in_silence(items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
    """Pass items on."""
    yield from items


def any_image(frame: int, image: LatlongImage) -> None:
    """Take an image as it is."""


def following_events(on_progress: OnProgress) -> Follow:
    """Return what tells the caller of a shot how far its keys are."""

    def follow(items: Iterable[_Item], label: str, count: int) -> Iterator[_Item]:
        for done, item in enumerate(items, 1):
            yield item
            on_progress(Keyed(label, done, count))

    return follow


@dataclass(frozen=True)
class Keying:
    """What finds and cuts the keys of a shot; `write_usd` has it write them.

    Attributes:
        sequence: Its images, as large as its rest shall be.
        options: How many keys, and as what.
        follow: Shows how far it is.
        check: Called with each frame and its image before anything is cut.
    """

    sequence: Sequence
    options: KeyOptions
    follow: Follow = field(default=in_silence)
    check: Callable[[int, LatlongImage], None] = field(default=any_image)

    def write(self, tracks: LobeTracks, folder: Path, stem: str, space: Space) -> WrittenKeys:
        """Find the keys, write the images of their rest and of their textures.

        Args:
            tracks: The shot's lobes, after which keys are named.
            folder: Where, which is there.
            stem: Of the names: `<stem>.rest.<frame>.exr` and `<stem>.<key>.<frame>.exr`.
            space: Of the stage's colours.

        Raises:
            InputError: An image cannot be read or written.
        """
        count = len(tracks.frames)
        with one_thread():
            seen = [
                self._sightings(frame)
                for frame in self.follow(tracks.frames, "looking for lamps", count)
            ]
            lamps = following.keys(seen, self.options.count)
            shot = _Shot(tracks, seen, lamps, key_names(lamps, tracks), self.options)
            target = Target(folder, stem, space)
            for place, frame in enumerate(self.follow(tracks.frames, "cutting keys", count)):
                shot.cut(place, self._radiance(frame), target)
        return shot.written()

    def _sightings(self, frame: int) -> list[Sighting]:
        image = self.sequence.read_or_fill(frame)
        self.check(frame, image)
        return sightings(_small(image.radiance))

    def _radiance(self, frame: int) -> Tensor:
        return self.sequence.read_or_fill(frame).radiance


class _Shot:
    """The keys of a shot while its frames are cut, one after the other."""

    def __init__(
        self,
        tracks: LobeTracks,
        seen: list[list[Sighting]],
        lamps: list[Track],
        names: tuple[str, ...],
        options: KeyOptions,
    ) -> None:
        self._frames, self._seen, self._lamps = tracks.frames, seen, lamps
        self._names, self._options = names, options
        count = len(tracks.frames)
        self._flux = np.zeros((count, len(lamps), 3))
        self._cards: list[list[Card | None]] = [[None] * len(lamps) for _ in range(count)]
        self._floors: list[float | None] = [None] * len(lamps)
        self._rest: list[Path] = []
        self._textures: list[list[Path]] = [[] for _ in lamps]
        self._reports: list[list[KeyFrame]] = []

    def cut(self, place: int, radiance: Tensor, target: Target) -> None:
        """Cut a frame and write its images.

        Args:
            place: Of the frame in the shot.
            radiance: Its map.  [H, W, 3]
            target: Where images go.
        """
        small = _small(radiance)
        chosen, wanted = self._wanted(place, small)
        mine = {id(lamp.seen.get(place)) for lamp in self._lamps}
        others = [_mask(one.place, small) for one in self._seen[place] if id(one) not in mine]
        found = frame_cut(small, wanted, others, whole=self._options.texture)
        divided = parts(found, radiance)
        for key, own, flux in zip(chosen, found.keys, divided.flux, strict=True):
            if own is not None:
                self._cards[place][key] = own.card
                self._floors[key] = own.floor
                self._flux[place, key] = flux.numpy()
        number = f"{self._frames[place]:04d}"
        self._rest.append(target.write(f"rest.{number}", divided.rest, latlong=True))
        if self._options.texture:
            self._write_textures(place, radiance, found, chosen, target)
        self._reports.append(report.of_frame(radiance, divided, found, chosen))

    def _wanted(self, place: int, small: Tensor) -> tuple[list[int], list[Wanted]]:
        chosen, wanted = [], []
        for key, lamp in enumerate(self._lamps):
            weight = following.weight(lamp, place, len(self._frames))
            if weight > 0:
                mask = _lamp_mask(lamp, place, small)
                start = self._cards[place - 1][key] if place else None
                start = start and _moved(start, lamp, place)
                chosen.append(key)
                wanted.append(Wanted(mask, weight, start, self._floors[key]))
        return chosen, wanted

    def _write_textures(
        self, place: int, radiance: Tensor, cut: FrameCut, chosen: list[int], target: Target
    ) -> None:
        for index, key in enumerate(chosen):
            own = cut.keys[index]
            if own is None:
                continue
            rows, light = light_of(cut, index, radiance)
            shape = texture.size(own.card, len(radiance))
            image = texture.rectified(own.card, shape, light, rows.start)
            name = f"{self._names[key]}.{self._frames[place]:04d}"
            self._textures[key].append(target.write(name, image, latlong=False))

    def written(self) -> WrittenKeys:
        """Return the keys of the shot."""
        document = report.document(self._reports, self._frames, self._names, self._lamps)
        lobes = self._lobes()
        textures = tuple(
            self._of_every_frame(key, paths) for key, paths in enumerate(self._textures)
        )
        return WrittenKeys(
            self._names, lobes, tuple(self._rest), textures, self._options.lights, document
        )

    def _of_every_frame(self, key: int, paths: list[Path]) -> tuple[Path, ...]:
        """Return a texture for each frame: dark frames have that of the lit one before, or after.

        Empty where the key has none.
        """
        if not paths:
            return ()
        lit = [cards[key] is not None for cards in self._cards]
        return tuple(paths[max(0, sum(lit[: place + 1]) - 1)] for place in range(len(lit)))

    def _lobes(self) -> Lobes | None:
        """Return the keys as lobes; a dark one has the card of the nearest lit frame.  [F, K]."""
        lit = np.array([[card is not None for card in frame] for frame in self._cards])
        if not lit.any():
            return None
        found: list[list[Card]] = [[] for _ in self._frames]
        for key in range(lit.shape[1]):
            places = np.flatnonzero(lit[:, key])
            for frame, own in enumerate(found):
                card = None
                if len(places):
                    card = self._cards[int(places[np.abs(places - frame).argmin()])][key]
                own.append(card or UNLIT)
        return as_lobes(found, self._flux)


UNLIT = Card.facing(np.eye(3), np.full(2, 0.01))
"""Of a key that is never lit."""


def key_names(lamps: list[Track], tracks: LobeTracks) -> tuple[str, ...]:
    """Name keys after the lobes that stand on them: `key_03` after `lobe_03`.

    Lobes keep their names over fits, so keys do. Of two keys on one lobe the brighter has its name.

    Args:
        lamps: The keys, the one with most light first.
        tracks: The lobes.
    """
    names: list[str] = []
    for lamp in lamps:
        light = torch.zeros(tracks.lobes.count)
        for place, one in lamp.seen.items():
            direction = torch.from_numpy(one.direction).float()[None]
            own = tracks.lobes[place].to("cpu", torch.float32)
            values = asg.unit_lobes(own, direction)[:, 0] * own.amplitude.mean(-1)
            light += values
        for index in light.argsort(descending=True).tolist():
            if float(light[index]) > 0:
                name = tracks.names[index].replace("lobe", "key")
                name = name if "key" in name else f"key_{name}"
                if name not in names:
                    names.append(name)
                    break
        else:
            taken = [name.replace("key", "lobe") for name in (*names, *tracks.names)]
            names.append(f"key_{first_unused(taken):02d}")
    return tuple(names)


def _small(radiance: Tensor) -> Tensor:
    rows = min(ROWS, len(radiance))
    return latlong.reduce(radiance, rows, 2 * rows)


def _mask(place: Places, small: Tensor) -> Mask:
    mask = np.zeros(small.shape[:2], dtype=bool)
    mask.ravel()[place] = True
    return mask


def _lamp_mask(lamp: Track, place: int, small: Tensor) -> Mask:
    """Return the texels of a lamp; where it is not found, a disc where it should be."""
    direction, texels, radius = lamp.at(place)
    if texels is not None:
        return _mask(texels, small)
    grid = Grid.of(*small.shape[:2])
    cosine = grid.directions @ direction
    return cosine >= min(np.cos(radius), float(cosine.max()))


def _moved(card: Card, lamp: Track, place: int) -> Card:
    """Turn the card of the frame before as its lamp has turned."""
    before, now = lamp.at(place - 1)[0], lamp.at(place)[0]
    return card.turned(turn_between(before, now))
