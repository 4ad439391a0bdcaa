# SPDX-License-Identifier: Apache-2.0
"""Keys and rest of stages that are put together, or seen at other times.

The light of keys and rest is that of the images at every frame. It stays so where both are mixed by
the same shares: flux of keys is linear between frames and over the frames that two parts have, so
images of the rest are dissolved likewise. Held, they would step, and keys and rest together be as
bright as no image. Pixels of a lamp are its own: its card shows those of the nearest frame.

Symbols: F frames, K keys.
"""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.shots.keyed.images import Target
from asglight.usd.options import KeyLights
from asglight.usd.read.keys import HeldKeys
from asglight.usd.spaces import Space
from asglight.usd.stage import image_file
from asglight.usd.write.keys import WrittenKeys


@dataclass(frozen=True)
class Share:
    """A part of what a frame shows.

    Attributes:
        source: Which stage's.
        place: Of the frame there.
        weight: In (0, 1]; those of a frame sum to 1.
    """

    source: int
    place: int
    weight: float


@dataclass(frozen=True)
class MixedKeys:
    """Keys and rest that come of those of stages (`usd.write.keys.KeySource`).

    Attributes:
        tracks: The keys; None where no stage has one.  [F, K, .]
        frames: Frame numbers.  F
        sources: What the stages hold.
        shares: What each frame shows.  F
        same: Of each stage, which of the keys each of its own is.
        document: What is told of the keys.
    """

    tracks: LobeTracks | None
    frames: tuple[int, ...]
    sources: Sequence[HeldKeys]
    shares: Sequence[Sequence[Share]]
    same: Sequence[Sequence[int]]
    document: dict[str, Any]

    def write(self, tracks: LobeTracks, folder: Path, stem: str, space: Space) -> WrittenKeys:
        """Mix and write the images; arguments as of `KeySource`."""
        target = Target(folder, stem, space)
        rest = []
        for frame, shares in zip(self.frames, self.shares, strict=True):
            rest.append(target.write(f"rest.{frame:04d}", self._rest(frame, shares), latlong=True))
        names = () if self.tracks is None else self.tracks.names
        textures = tuple(self._textures(key, name, target) for key, name in enumerate(names))
        lobes = None if self.tracks is None else self.tracks.lobes
        called = {} if self.tracks is None else self.tracks.display_names
        return WrittenKeys(names, lobes, tuple(rest), textures, self.lights, self.document, called)

    @property
    def lights(self) -> KeyLights:
        """What a key shines as: as in the first stage that has one."""
        lit = (one.lights for one in self.sources if one.keys.tracks is not None)
        return next(lit, KeyLights.RECT)

    def _rest(self, frame: int, shares: Sequence[Share]) -> Tensor:
        images = [self.sources[one.source].keys.rest.radiance(one.place) for one in shares]
        if len({image.shape for image in images}) > 1:
            raise InputError(
                f"rest: images of several sizes at frame {frame}; expected one. Cut the keys of "
                "the parts with the same --rest-height."
            )
        if len(images) == 1:
            return images[0]
        return sum(
            (one.weight * image for one, image in zip(shares, images, strict=True)), 0 * images[0]
        )

    def _textures(self, key: int, name: str, target: Target) -> tuple[Path, ...]:
        """Copy the pixels of a key; empty where it has none in a frame that shows it."""
        images = [self._texture(key, shares) for shares in self.shares]
        known = [place for place, image in enumerate(images) if image]
        if not known:
            return ()
        copies: dict[str, Path] = {}
        for place in known:
            image = images[place]
            if image not in copies:
                copies[image] = target.path(f"{name}.{self.frames[place]:04d}")
                with image_file(image) as file:
                    shutil.copyfile(file, copies[image])
        nearest = [min(known, key=lambda at: abs(at - place)) for place in range(len(images))]
        return tuple(copies[images[place]] for place in nearest)

    def _texture(self, key: int, shares: Sequence[Share]) -> str:
        """Return the pixels of a key at a frame, of the stage that has most of it; "" for none."""
        for share in sorted(shares, key=lambda one: -one.weight):
            source = self.sources[share.source]
            for own, same in enumerate(self.same[share.source]):
                if same == key and source.textures[own]:
                    return source.textures[own][share.place]
        return ""


def resampled_shares(numbers: Sequence[int], times: Sequence[float]) -> list[list[Share]]:
    """Return what frames at some times show of one stage.

    Args:
        numbers: Its frame numbers.
        times: In them.
    """
    known = torch.tensor(numbers, dtype=torch.float64)
    found = []
    for time in times:
        at = min(max(time, numbers[0]), numbers[-1])
        before = int((known <= at).sum()) - 1
        after = min(before + 1, len(numbers) - 1)
        part = (at - numbers[before]) / max(numbers[after] - numbers[before], 1)
        shares = [Share(0, before, 1 - part), Share(0, after, part)]
        found.append([one for one in shares if one.weight > 0])
    return found


def stitched_shares(parts: Sequence[Sequence[int]]) -> dict[int, list[Share]]:
    """Return what each frame of a shot shows of its parts.

    Over the frames that two parts have it goes over from one to the other evenly, as lobes do
    (`lobes.stitching`).

    Args:
        parts: Their frame numbers, in the order in which they begin.
    """
    found: dict[int, list[Share]] = {}
    for source, numbers in enumerate(parts):
        both = [number for number in numbers if number in found]
        for place, number in enumerate(numbers):
            part = 1.0
            if number in found:
                part = (both.index(number) + 1) / (len(both) + 1)
            earlier = [
                Share(one.source, one.place, one.weight * (1 - part))
                for one in found.get(number, [])
            ]
            found[number] = [*earlier, Share(source, place, part)]
    return dict(sorted(found.items()))


def same_keys(found: LobeTracks, part: LobeTracks) -> list[int]:
    """Return which key of a shot each key of a part is: the one that shines where it does.

    Args:
        found: The keys of the shot.
        part: Those of the part, whose frames the shot has.
    """
    places = [found.frames.index(frame) for frame in part.frames]
    whole, own = found.lobes[places], part.lobes
    cosine = own.axis_z.double() @ whole.axis_z.double().mT  # [F, K', K]
    light = own.amplitude.double().sum(-1)[..., None] * (whole.amplitude.sum(-1) > 0)[:, None]
    return (light * cosine.clamp(min=0) ** SHARP).sum(0).argmax(-1).tolist()


SHARP = 1000
"""Power of a cosine: what is 5 degrees off counts by a fiftieth."""


def merged_document(
    parts: Sequence[dict[str, Any]],
    numbers: Sequence[Sequence[int]],
    same: Sequence[Sequence[int]],
    names: Sequence[str],
) -> dict[str, Any]:
    """Return what is told of the keys of a shot, by what is told of those of its parts.

    Args:
        parts: What is told of the keys of each, in their order.
        numbers: The frame numbers of each.
        same: As of `MixedKeys`.
        names: Of the keys of the shot.
    """
    counts = [len(own) for own in numbers]
    rows = []
    for key, name in enumerate(names):
        own = [
            (row, count)
            for part, count, keys in zip(parts, counts, same, strict=True)
            for row, mine in zip(part["keys"], keys, strict=True)
            if mine == key
        ]
        if own:
            rows.append({"name": name, **_merged_row(own, sum(counts))})
    rows.sort(key=lambda row: -row["share"])
    return {
        "share": sum(part["share"] * n for part, n in zip(parts, counts, strict=True))
        / sum(counts),
        "share_min": min(part["share_min"] for part in parts),
        "share_max": max(part["share_max"] for part in parts),
        "keys": rows,
    }


def _merged_row(own: Sequence[tuple[dict[str, Any], int]], count: int) -> dict[str, Any]:
    """Return the means of a key's figures, weighted by its light in each part."""
    weights = torch.tensor([row["share"] * frames for row, frames in own], dtype=torch.float64)
    lit = [(row, weight) for (row, _), weight in zip(own, weights.tolist(), strict=True) if weight]
    row: dict[str, Any] = {"share": float(weights.sum()) / count}
    row["share_max"] = max(one["share_max"] for one, _ in own)
    for name in ("size_deg", "color", "stops", "carried", "apart", "rim"):
        values = [(one[name], weight) for one, weight in lit if one[name] is not None]
        row[name] = None
        if values:
            mean = sum(torch.tensor(value).double() * weight for value, weight in values)
            row[name] = (mean / sum(weight for _, weight in values)).tolist()
    row["frames"] = [
        min(one["frames"][0] for one, _ in own),
        max(one["frames"][1] for one, _ in own),
    ]
    return row
