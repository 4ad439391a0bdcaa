# SPDX-License-Identifier: Apache-2.0
"""What a stage's keys and rest show together, against the images (docs/guides/keys.md).

    python -m benchmarks.keyed.measure ../shared/hdri/*.exr ../shared/sequences/*
    python -m benchmarks.keyed.measure ../shared/hdri/*.exr --texture
    python -m benchmarks.keyed.measure --synthetic 100 --seed 1

The keys of each input are cut, and the stage is read by pxr alone: lights are what UsdLux says,
seen from the origin along rays through every texel, and the rest is its image.
The errors are those of docs/results/measures.md; of a sequence the worst frame counts. `flux` is
the largest error of a channel, `rim` the largest gradient of the rest within the rim of a matte
over that of the map around it, `pump` how much more the rest changes from frame to frame within the
mattes than around them, both of the logarithm of radiance.

Synthetic cases are those of `cases.py`. Their `corners` are the largest distance of a card's corner
from the one of the rectangle that it shows, over the rectangle's shorter side (or three texels,
where that is more). A second table has the worst of each kind and of all.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.fitting.options import FIT_HEIGHT
from asglight.images import Sequence as ImageSequence
from asglight.images import open_sequence, read_latlong, write_exr
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.strips import read_pixels
from asglight.judging.metrics import maps_errors
from asglight.lobes import Lobes, LobeTracks
from asglight.shots.keying import Keying
from asglight.sphere import latlong
from asglight.usd import WriteReport, write_usd
from asglight.usd.options import KeyLights, KeyOptions
from benchmarks.keyed.cases import Case, Quad, cases

RAYS = (12, 300)
"""Through a texel each way, at least and at most."""

RAYS_ACROSS = 150
"""Across the narrow side of a card: its flux is right to a few thousandths whatever its outline."""

SHOWN = ("env", "irr", "r0.5", "r0.25")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Light:
    """A light at a frame.

    Attributes:
        to_local: From the world to the light, for row vectors.  [4, 4]
        half: Half width and half height.
        radiance: Intensity times colour.  [3]
        image: Its texture, [M, N, 3]; None without.
    """

    to_local: Array
    half: tuple[float, float]
    radiance: Array
    image: NDArray[np.float32] | None


def main(argv: Sequence[str] | None = None) -> int:
    """Cut every input and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.keyed.measure", description=__doc__)
    parser.add_argument("inputs", nargs="*", metavar="INPUT", help="images, folders or patterns")
    parser.add_argument("--texture", action="store_true", help="keys carry the pixels of lamps")
    parser.add_argument("--keys", type=int, metavar="N", help="so many keys (default: auto)")
    parser.add_argument("--step", type=int, default=1, metavar="N", help="judge every Nth frame")
    parser.add_argument("--synthetic", type=int, default=0, metavar="N", help="cases by chance")
    parser.add_argument("--seed", type=int, default=1, help="of chance")
    parser.add_argument("--rows", type=int, default=128, help="of a synthetic map")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    heads = ["input", "keys", "keyed %", *SHOWN, "flux", "rim", "pump"]
    if options.inputs:
        _print_head([*heads, "MB"])
    for source in options.inputs:
        _print_row(judged(source, options).cells())
    if options.synthetic:
        print_synthetic(options, [*heads, "corners"])
    return 0


def _print_head(heads: Sequence[str]) -> None:
    _print_row(heads)
    _print_row(["---", *["---:"] * (len(heads) - 1)])


def _print_row(cells: Sequence[str]) -> None:
    print(f"| {' | '.join(cells)} |", flush=True)


@dataclass(frozen=True)
class Row:
    """The figures of an input.

    Attributes:
        name: Of the input.
        keys: How many.
        share: Of the light in keys.
        worst: `SHOWN` and `flux`, of the worst frame.
        rim: Of the worst key, None without one.
        pump: None of a still.
        bytes: Of the stage's files.
    """

    name: str
    keys: int
    share: float
    worst: dict[str, float]
    rim: float | None
    pump: float | None
    bytes: int

    def cells(self) -> list[str]:
        """Return the cells of a table."""
        return [*self.figures(), f"{self.bytes / 1e6:.2f}"]

    def figures(self) -> list[str]:
        """Return the cells up to `pump`."""
        return [
            self.name,
            str(self.keys),
            f"{100 * self.share:.1f}",
            *(f"{self.worst[name]:.4f}" for name in SHOWN),
            f"{self.worst['flux']:.0e}",
            *("–" if one is None else f"{one:.2f}" for one in (self.rim, self.pump)),
        ]


def judged(source: str, options: argparse.Namespace) -> Row:
    """Cut the keys of an input and judge its stage."""
    keys = _keys(options)
    written_from = open_sequence(source, missing="hold", height=keys.rest_height)
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "keys.usdc"
        written = _written(written_from, keys, stage)
        sequence = open_sequence(source, missing="hold", height=FIT_HEIGHT)
        return stage_row(sequence, stage, written.keys or {}, written.bytes, options.step)


def _keys(options: argparse.Namespace) -> KeyOptions:
    return KeyOptions(options.keys, KeyLights.RECT, options.texture)


def _written(sequence: ImageSequence, keys: KeyOptions, stage: Path) -> WriteReport:
    """Write the stage of a shot's keys beside a lobe that says nothing: keys are of images."""
    tracks = _one_lobe(sequence.frames)
    keying = Keying(sequence, keys)
    return write_usd(tracks, stage, representations=("keys",), keys=keying)


def stage_row(
    sequence: ImageSequence, stage: Path, told: dict[str, Any], size: int, step: int = 1
) -> Row:
    """Judge a stage of keys against its images.

    Args:
        sequence: The images.
        stage: The stage's file.
        told: What was said of its keys.
        size: Of its files, in bytes.
        step: Every which frame is judged.
    """
    frames = sequence.frames[::step]
    rows = [frame_row(stage, frame, sequence.read(frame).radiance) for frame in frames]
    rims = [key["rim"] for key in told["keys"] if key["rim"] is not None]
    return Row(
        sequence.name,
        len(told["keys"]),
        told["share"],
        {name: max(row[name] for row in rows) for name in (*SHOWN, "flux")},
        max(rims, default=None),
        pump(stage, sequence.frames, [sequence.read(f).radiance for f in sequence.frames]),
        size,
    )


def print_synthetic(options: argparse.Namespace, heads: Sequence[str]) -> None:
    """Judge cases by chance, print a row for each, then the worst of each kind and of all."""
    _print_head(heads)
    found: list[tuple[Row, float | None]] = []
    for case in cases(options.synthetic, options.seed, options.rows):
        found.append(judged_case(case, options))
        _print_row(_case_cells(*found[-1]))
    print()
    _print_head(heads)
    kinds = dict.fromkeys(row.name.rsplit(" ", 1)[0] for row, _ in found)
    for kind in [*kinds, ""]:
        of_kind = [one for one in found if one[0].name.startswith(kind)]
        _print_row(_case_cells(*_worst(of_kind, kind or "all")))


def _case_cells(row: Row, corners: float | None) -> list[str]:
    return [*row.figures(), "–" if corners is None else f"{corners:.3f}"]


def _worst(found: Sequence[tuple[Row, float | None]], name: str) -> tuple[Row, float | None]:
    rows = [row for row, _ in found]

    def most(values: Sequence[float | None]) -> float | None:
        return max((one for one in values if one is not None), default=None)

    worst = {key: max(row.worst[key] for row in rows) for key in rows[0].worst}
    whole = Row(
        name,
        max(row.keys for row in rows),
        max(row.share for row in rows),
        worst,
        most([row.rim for row in rows]),
        most([row.pump for row in rows]),
        0,
    )
    return whole, most([corners for _, corners in found])


def judged_case(case: Case, options: argparse.Namespace) -> tuple[Row, float | None]:
    """Cut the keys of a case, and judge its stage.

    Returns:
        Its row, and how far corners are off, None where none are known.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        numbers = range(1001, 1001 + len(case.frames))
        for number, image in zip(numbers, case.frames, strict=True):
            write_exr(folder / f"case.{number}.exr", image)
        sequence = open_sequence(folder / "case.####.exr")
        written = _written(sequence, _keys(options), folder / "keys.usdc")
        told = written.keys or {}
        row = stage_row(sequence, folder / "keys.usdc", told, written.bytes)
        row = replace(row, name=case.name)
        if not case.quads or options.texture or not told["keys"]:
            return row, None
        stage = Usd.Stage.Open(str(folder / "keys.usdc"))
        texel = np.pi / len(case.frames[0])
        return row, corners_off(lights(stage, numbers[0]), case.quads, texel)


def _one_lobe(frames: tuple[int, ...]) -> LobeTracks:
    count = len(frames)
    lobes = Lobes(
        torch.eye(3).expand(count, 1, 3, 3),
        torch.full((count, 1, 2), 2.0),
        torch.full((count, 1, 3), 1e-3),
    )
    return LobeTracks(frames, 24.0, lobes)


def corners_off(found: Sequence[Light], quads: Sequence[Quad], texel: float) -> float | None:
    """Return how far corners are off, the worst of the lights that stand on a lamp.

    It is over the shorter side of a lamp, or three texels, where that is more.
    """
    worst = None
    for light in found:
        world = np.linalg.inv(light.to_local)
        local = [[i * light.half[0], j * light.half[1], 0, 1] for i, j in ROUND]
        corners = (np.array(local) @ world)[:, :3]
        corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
        for quad in quads:
            if not quad.covers(corners.mean(0)[None])[0]:
                continue
            orders = [np.roll(one, k, 0) for one in (corners, corners[::-1]) for k in range(4)]
            away = min(
                float(np.arccos(np.clip((one * quad.corners).sum(-1), -1, 1)).max())
                for one in orders
            )
            sides = np.arccos((quad.corners * np.roll(quad.corners, 1, 0)).sum(-1))
            worst = max(worst or 0.0, away / max(float(sides.min()), 3 * texel))
    return worst


ROUND = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def frame_row(stage: Path, frame: int, reference: Tensor) -> dict[str, float]:
    """Return the errors of a frame."""
    opened = Usd.Stage.Open(str(stage))
    shown = seen(opened, frame, *reference.shape[:2])
    errors = maps_errors(torch.from_numpy(shown).float()[None], reference)[0].values
    return {**errors, "flux": flux_error(opened, frame, reference)}


def seen(stage: Usd.Stage, frame: int, height: int, width: int) -> Array:
    """Return what lights and rest show at the origin, a mean a texel.  [H, W, 3]."""
    image = read_latlong(rest_image(stage, frame)).radiance.double()
    found = latlong.reduce(image, height, width).numpy().copy()
    for light in lights(stage, frame):
        add(found, light)
    return found


def rest_image(stage: Usd.Stage, frame: int) -> str:
    """Return the file of the rest at a frame."""
    dome = UsdLux.DomeLight(next(p for p in stage.Traverse() if p.GetName() == "Rest"))
    return dome.GetTextureFileAttr().Get(frame).resolvedPath


def lights(stage: Usd.Stage, frame: int) -> list[Light]:
    """Return the rectangles of a stage, as UsdLux says them."""
    found = []
    cache = UsdGeom.XformCache(frame)
    for prim in stage.Traverse():
        if not prim.IsA(UsdLux.RectLight):
            continue
        rect = UsdLux.RectLight(prim)
        api = UsdLux.LightAPI(prim)
        assert not api.GetNormalizeAttr().Get(frame)
        color = np.array(api.GetColorAttr().Get(frame), dtype=np.float64)
        asset = rect.GetTextureFileAttr().Get(frame)
        image = None
        if asset and asset.resolvedPath:
            image = read_pixels(read_header(Path(asset.resolvedPath)))
        half = rect.GetWidthAttr().Get(frame) / 2, rect.GetHeightAttr().Get(frame) / 2
        matrix = np.array(cache.GetLocalToWorldTransform(prim))
        radiance = api.GetIntensityAttr().Get(frame) * color
        found.append(Light(np.linalg.inv(matrix), half, radiance, image))
    return found


def add(image: Array, light: Light) -> None:
    """Add what a light shows to the texels of a map, along many rays through each."""
    height, width = image.shape[:2]
    corners = np.array([[x, y, 0, 1] for x in (-1, 1) for y in (-1, 1)]) * [*light.half, 1, 1]
    world = np.linalg.inv(light.to_local)
    points = (corners @ world)[:, :3]
    middle = world[3, :3] / np.linalg.norm(world[3, :3])
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    reach = np.arccos(np.clip((points @ middle).min(), -1, 1)) + 2 * np.pi / height
    centres = latlong.directions(height, width, dtype=torch.float64).numpy()
    row, column = np.nonzero(centres @ middle >= np.cos(min(reach, np.pi)))
    narrow = 2 * min(light.half) / np.linalg.norm(world[3, :3])
    rays = int(np.clip(RAYS_ACROSS * np.pi / height / narrow, *RAYS))
    inner = (np.arange(rays) + 0.5) / rays
    solid = np.zeros(len(row))
    total = np.zeros((len(row), 3))
    for down in inner:
        latitude = np.pi / 2 - np.pi * (row + down) / height
        for right in inner:
            longitude = np.pi - 2 * np.pi * (column + right) / width
            ray = np.stack(
                [
                    np.cos(latitude) * np.sin(longitude),
                    np.sin(latitude),
                    np.cos(latitude) * np.cos(longitude),
                ],
                axis=-1,
            )
            weight = np.cos(latitude)
            total += weight[:, None] * radiance_along(light, ray)
            solid += weight
    image[row, column] += total / solid[:, None]


def radiance_along(light: Light, ray: Array) -> Array:
    """Return what a light shows along rays from the origin.  [P, 3]."""
    origin = np.array([0, 0, 0, 1.0]) @ light.to_local
    local = np.concatenate([ray, np.zeros((len(ray), 1))], axis=-1) @ light.to_local
    faces = local[:, 2] > 0  # it shines along -z
    far = -origin[2] / np.where(faces, local[:, 2], 1)
    x, y = (origin[k] + far * local[:, k] for k in (0, 1))
    hit = faces & (np.abs(x) <= light.half[0]) & (np.abs(y) <= light.half[1])
    if light.image is None:
        return hit[:, None] * light.radiance
    rows, columns = light.image.shape[:2]
    # the first texel of the first row is at (+x, +y)
    u = ((1 - x / light.half[0]) / 2 * columns).clip(0, columns - 1).astype(int)
    v = ((1 - y / light.half[1]) / 2 * rows).clip(0, rows - 1).astype(int)
    return hit[:, None] * light.radiance * light.image[v, u]


def flux_error(stage: Usd.Stage, frame: int, reference: Tensor) -> float:
    """Return the largest relative error of a channel's flux, of cards in closed form."""
    image = read_latlong(rest_image(stage, frame)).radiance
    found = _flux(image)
    for light in lights(stage, frame):
        distance = np.linalg.norm(np.linalg.inv(light.to_local)[3, :3])
        p, q = (float(half / distance) for half in light.half)
        found += light.radiance * _solid_angle(p, q) * _mean(light.image, p, q)
    truth = _flux(reference)
    return float(np.abs(found / truth - 1)[truth > 0].max())


def _flux(image: Tensor) -> Array:
    solid = latlong.texel_solid_angles(*image.shape[:2], dtype=torch.float64)[..., None]
    return (image.double() * solid).sum((0, 1)).numpy()


def _solid_angle(p: float, q: float) -> float:
    return float(4 * np.arctan(p * q / np.sqrt(1 + p * p + q * q)))


def _mean(image: NDArray[np.float32] | None, p: float, q: float) -> Array:
    if image is None:
        return np.ones(3)
    rows, columns = image.shape[:2]
    y, x = ((2 * (np.arange(n) + 0.5) / n - 1) * e for n, e in ((rows, q), (columns, p)))
    weight = (1 + x * x + (y * y)[:, None]) ** -1.5
    return (image * weight[..., None]).sum((0, 1)) / weight.sum()


DARK, UNSEEN = 0.05, 0.01
"""As of `asglight.keys.report.rim_gradients`: what is added to radiance before its logarithm, over
the median around mattes, and the change from frame to frame that no eye sees."""


def pump(stage: Path, frames: Sequence[int], maps: Sequence[Tensor]) -> float | None:
    """Return how the rest changes from frame to frame where keys are, over the map around them.

    Texels in which rest and map differ are those of mattes; around them is a band as wide as two
    texels. The change is the mean of the absolute differences of neighbouring frames, of the
    logarithm of radiance.
    """
    if len(frames) < 2:
        return None
    opened = Usd.Stage.Open(str(stage))
    inside, around = [], []
    last: tuple[Tensor, Tensor, Tensor] | None = None
    for frame, truth in zip(frames, maps, strict=True):
        rest = latlong.reduce(read_latlong(rest_image(opened, frame)).radiance, *truth.shape[:2])
        cut = ((rest - truth).abs() > 1e-3 * truth.clamp(min=1e-6)).any(-1)
        if last is not None:
            both, band = cut & last[2], _grown(_grown(cut | last[2])) & ~(cut | last[2])
            if both.any() and band.any():
                dark = DARK * float(truth.mean(-1)[band].median())
                inside.append(_change(last[0], rest, dark, both))
                around.append(max(_change(last[1], truth, dark, band), UNSEEN))
        last = rest, truth, cut
    return float(np.mean(inside) / np.mean(around)) if inside else None


def _change(before: Tensor, after: Tensor, dark: float, where: Tensor) -> float:
    ratio = (after.mean(-1)[where] + dark) / (before.mean(-1)[where] + dark)
    return float(ratio.log().abs().mean())


def _grown(mask: Tensor) -> Tensor:
    wide = mask | mask.roll(1, 1) | mask.roll(-1, 1)
    found = wide.clone()
    found[1:] |= wide[:-1]
    found[:-1] |= wide[1:]
    return found


if __name__ == "__main__":
    sys.exit(main())
