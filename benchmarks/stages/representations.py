# SPDX-License-Identifier: Apache-2.0
"""Measure what each representation of a stage shows, against the lobes and against the map.

For every map: fit 15 lobes, write the stage, read its lights back from the file, and light white
balls with them, with the lobes themselves (float64 quadrature) and with the map. Balls are a
Lambertian one and GGX of roughness 0.5 and 0.25 (Fresnel reflectance 1), each seen from four sides.
Cells are Lambert / 0.5 / 0.25 in percent over all sides, RGB and points of the four balls' images.

    python -m benchmarks.stages.representations --maps ../shared/hdri
    python -m benchmarks.stages.representations --stages day.usda tunnel.usda
"""

import argparse
import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from pxr import Usd
from torch import Tensor

from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Form, LobeTracks
from asglight.lobes.data import stack
from asglight.shading import ggx
from asglight.usd import Representation, read_usd, write_usd
from asglight.usd.options import OF_LOBES
from benchmarks.given import map_paths, read_map, refused_in_a_line
from benchmarks.stages import representations_lights as lights
from benchmarks.stages.representations_lights import Arriving

ROUGHNESS = (0.5, 0.25)
POINTS = 100
"""Of each ball's image, evenly spread; twice as many change the numbers by a tenth."""
EDGE = 0.9
"""Squared radius of the image beyond which no point lies: n.v is above 0.32. Nearer to the rim a
reflection is narrower than the nodes are dense."""
AT_ONCE = 1 << 17
"""Products of a point and a direction made at a time: 1 MiB in float64, within the cache."""


class Way(NamedTuple):
    """One way in which light is written.

    Attributes:
        stage: The file.
        representation: Its variant.
        card_texture: Whether the texture of cards is shown.
    """

    stage: Path
    representation: str
    card_texture: bool = True


class Case(NamedTuple):
    """One frame of one stage.

    Attributes:
        name: Of the map, or of the stage and its frame.
        ways: What is measured, by name.
        frame: Time code.
        reference: The map, where there is one.  [H, W, 3]
    """

    name: str
    ways: dict[str, Way]
    frame: float
    reference: Tensor | None


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    inputs = parser.add_mutually_exclusive_group(required=True)
    inputs.add_argument("--maps", type=Path, help="folder of latlong maps")
    inputs.add_argument("--stages", type=Path, nargs="+", default=[], help="stages of asglight")
    form_help = "lobe form of the maps' fits (asg)"
    parser.add_argument("--form", type=Form, default=Form.ASG, help=form_help)
    options = parser.parse_args(argv)
    maps = map_paths(parser, options.maps) if options.maps else []
    with tempfile.TemporaryDirectory() as folder, refused_in_a_line(parser):
        cases = of_maps(maps, options.form, Path(folder)) if maps else of_stages(options.stages)
        print_tables({case.name: measured(case) for case in cases})


def of_maps(maps: Sequence[Path], form: Form, folder: Path) -> Iterator[Case]:
    """Fit every map and write its stages."""
    for path in maps:
        radiance = read_map(path)
        lobes = fit_frame(radiance, FitOptions(form=form), previous=None).lobes
        tracks = LobeTracks((1,), 24.0, stack([lobes.to(torch.float32)]))
        yield Case(path.stem, written(tracks, folder, path.stem), 1.0, radiance)


def written(tracks: LobeTracks, folder: Path, stem: str) -> dict[str, Way]:
    """Write the stages that hold the representations of some tracks."""
    plain, options = folder / f"{stem}.usda", folder / f"{stem}-options.usda"
    every = OF_LOBES
    write_usd(tracks, plain, representations=every)
    write_usd(tracks, options, representations=every, distant_lights=3, card_texture=True)
    return {
        "cards": Way(plain, Representation.CARDS),
        "cards, texture": Way(options, Representation.CARDS),
        "texture left out": Way(options, Representation.CARDS, card_texture=False),
        "distant": Way(plain, Representation.DISTANT),
        "distant x 3": Way(options, Representation.DISTANT),
        "dome": Way(plain, Representation.DOME),
    }


def of_stages(stages: Sequence[Path]) -> Iterator[Case]:
    """Take the first, the middle and the last frame of every stage."""
    for path in stages:
        frames = read_usd(path).frames
        for frame in sorted({frames[0], frames[len(frames) // 2], frames[-1]}):
            held = {str(shown): Way(path, shown) for shown in OF_LOBES}
            yield Case(f"{path.stem} {frame}", held, float(frame), None)


def measured(case: Case) -> dict[str, dict[str, list[float]]]:
    """Return the figures of each representation, and of the lobes against the map.

    Returns:
        Name of the representation, or `lobes`, to figure, to one number for each ball.
    """
    lobes = read_usd(next(iter(case.ways.values())).stage).at(int(case.frame))
    truth = lights.of_lobes(lobes)
    wanted = shown(truth)
    by_map = None if case.reference is None else shown(lights.of_map(case.reference))
    result: dict[str, dict[str, list[float]]] = (
        {"lobes": {"map": _l1(wanted, by_map)}} if by_map is not None else {}
    )
    for name, way in case.ways.items():
        stage = opened(way.stage, way.representation)
        arriving, count = lights.of_stage(stage, case.frame, card_texture=way.card_texture)
        found = shown(arriving)
        flux = arriving.light.sum(0) / truth.light.sum(0) - 1
        result[name] = {
            "rmse": [float((f - w).norm() / w.norm()) for f, w in zip(found, wanted, strict=True)],
            "l1": _l1(found, wanted),
            "flux": [float(flux.abs().max())],
            "lights": [count],
        }
        if by_map is not None:
            result[name]["map"] = _l1(found, by_map)
    return result


def opened(path: Path, representation: str) -> Usd.Stage:
    """Open a stage in one of its variants."""
    stage = Usd.Stage.Open(str(path))
    stage.SetEditTarget(stage.GetSessionLayer())
    rig = stage.GetDefaultPrim()
    rig.GetVariantSet("representation").SetVariantSelection(representation)
    return stage


def shown(arriving: Arriving) -> list[Tensor]:
    """Return what white balls show, the Lambertian one first.  1 + R times [V * P, 3]."""
    normals, views = ball_points()
    result = [torch.zeros(len(normals), 3, dtype=torch.float64) for _ in range(1 + len(ROUGHNESS))]
    step = max(1, AT_ONCE // len(normals))
    for start in range(0, len(arriving.light), step):
        directions = arriving.directions[start : start + step]
        light = arriving.light[start : start + step]
        cosine = (normals @ directions.mT).clamp(min=0)  # [V * P, K]
        result[0] += cosine @ light / math.pi
        halves = torch.nn.functional.normalize(directions + VIEWS[:, None], dim=-1)  # [V, K, 3]
        by_view = normals.view(len(VIEWS), -1, 3)
        toward = (by_view @ halves.mT).reshape(cosine.shape)
        sin2 = (1 - toward * toward).clamp(min=0)
        for index, roughness in enumerate(ROUGHNESS):
            alpha = roughness**2
            kernel = ggx.distribution(sin2, alpha) * ggx.visibility(views, cosine, alpha) * cosine
            result[1 + index] += kernel @ light
    return result


VIEWS = torch.tensor(
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]], dtype=torch.float64
)
"""Towards the eye."""


def ball_points() -> tuple[Tensor, Tensor]:
    """Spread points over the images of four balls.

    Returns:
        Unit normals [V * P, 3], and their cosines to the view [V * P, 1].
    """
    index = torch.arange(POINTS, dtype=torch.float64) + 0.5
    radius = (index / POINTS * EDGE).sqrt()
    turn = math.pi * (3 - math.sqrt(5)) * index
    local = torch.stack(
        [radius * turn.cos(), radius * turn.sin(), (1 - radius * radius).sqrt()], dim=-1
    )
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64).expand_as(VIEWS)
    frames = torch.stack([torch.linalg.cross(up, VIEWS), up, VIEWS], dim=-2)  # [V, 3, 3]
    return (local @ frames).reshape(-1, 3), local[:, 2].repeat(len(VIEWS))[:, None]


def print_tables(rows: dict[str, dict[str, dict[str, list[float]]]]) -> None:
    """Print one table for each figure: a row for each case, then the mean and the worst."""
    titles = {
        "rmse": "RMSE against the lobes, relative to their RMS",
        "l1": "Absolute error against the lobes, relative to their light",
        "map": "Absolute error against the map, relative to its light",
        "flux": "Flux, error of the worst channel",
        "lights": "Lights",
    }
    for figure, title in titles.items():
        names = [n for n, figures in next(iter(rows.values())).items() if figure in figures]
        if not names:
            continue
        print(f"\n{title}\n\n| | " + " | ".join(names) + " |")
        print("|---" * (len(names) + 1) + "|")
        table = {
            case: [torch.tensor(found[name][figure], dtype=torch.float64) for name in names]
            for case, found in rows.items()
        }
        columns = [torch.stack(column) for column in zip(*table.values(), strict=True)]
        table["**mean**"] = [column.mean(0) for column in columns]
        table["**worst**"] = [column.amax(0) for column in columns]
        for case, cells in table.items():
            print(f"| {case} | " + " | ".join(_cell(cell, figure) for cell in cells) + " |")


def _cell(values: Tensor, figure: str) -> str:
    if figure == "lights":
        return f"{float(values[0]):.0f}"
    digits = 3 if figure == "flux" else 1
    return " / ".join(f"{100 * value:.{digits}f}" for value in values.tolist())


def _l1(found: list[Tensor], wanted: list[Tensor]) -> list[float]:
    return [
        float((one - other).abs().sum() / other.abs().sum())
        for one, other in zip(found, wanted, strict=True)
    ]


if __name__ == "__main__":
    main()
