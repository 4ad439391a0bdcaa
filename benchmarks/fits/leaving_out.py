# SPDX-License-Identifier: Apache-2.0
"""What a scene does not need: the fewest lobes that a tolerance allows, found as a shot finds them.

Every map and every sequence is fitted with a tolerance and judged by asglight.judging; so are two
skies that are drawn here, one of them overcast. Results are plain dictionaries, as fit.json holds
them. Seconds are CPU seconds of the process that fits: another one decodes the images.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from asglight.cli.progress import Reporter
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import open_sequence, write_exr
from asglight.images import sequence as image_sequence
from asglight.judging.clock import timed
from asglight.judging.metrics import frame_errors
from asglight.lobes import LobeTracks
from asglight.shots import fit_sequence
from asglight.sky import SkyConfig, radiance

FRAMES = 24
"""Of each sequence, unless --frames asks for more or fewer."""

SKY_ROWS = 128
"""Rows of the drawn skies, as of the sequences at hand."""

OVERCAST = SkyConfig(cloud_depth=15.0, cloud_size=(60.0, 60.0), lamps=())
"""The built-in sky under a cloud that covers all of it."""

HEADER = ["input", "frames", "lobes", "worst irr", "worst r0.5", "met", "isotropic", "CPU s"]


def measured(
    maps: Sequence[Path],
    sequences: Sequence[image_sequence.Sequence],
    tolerance: float,
    frames: int | None,
    folder: Path,
    report: Reporter,
) -> dict[str, dict[str, Any]]:
    """Fit all inputs with a tolerance; return lobes, errors and seconds by name.

    Args:
        maps: Stills.
        sequences: Moving ones.
        tolerance: Largest irr and r0.5.
        frames: The first so many of each sequence.
        folder: Where the skies are drawn.
        report: Shows progress.
    """
    sources: list[tuple[str, str, str | None]] = [(path.stem, str(path), None) for path in maps]
    overcast = OVERCAST.frames[len(OVERCAST.frames) // 2]
    sources.append(("overcast sky", drawn(OVERCAST, [overcast], folder / "overcast"), None))
    clear = SkyConfig()
    several = list(clear.frames[: frames or FRAMES])
    sources.append(("built-in sky", drawn(clear, several, folder / "sky"), None))
    for sequence in sequences:
        chosen = sequence.frames[: frames or FRAMES]
        sources.append((sequence.name, sequence.pattern, f"{chosen[0]}-{chosen[-1]}"))
    label = f"leaving out: tolerance {tolerance:g}"
    return {
        name: account(source, chosen, tolerance)
        for name, source, chosen in report.follow(sources, label, len(sources))
    }


def drawn(config: SkyConfig, frames: list[int], folder: Path) -> str:
    """Write frames of a sky and return their pattern."""
    folder.mkdir(exist_ok=True)
    for frame in frames:
        write_exr(folder / f"{folder.name}.{frame}.exr", radiance(config, frame, SKY_ROWS))
    return str(folder / f"{folder.name}.####.exr")


def account(source: str, frames: str | None, tolerance: float) -> dict[str, Any]:
    """Fit one input with a tolerance and judge every frame of it."""
    tracks, seconds = timed(fit_sequence, source, frames=frames, tolerance=tolerance)
    sequence = open_sequence(source, frames=frames, height=FIT_HEIGHT)
    judged = [
        frame_errors(tracks.at(frame), sequence.read(frame).radiance).values
        for frame in tracks.frames
    ]
    return _row(tracks) | {
        "judged": {name: max(values[name] for values in judged) for name in ("irr", "r0.5")},
        **seconds,
    }


def _row(tracks: LobeTracks) -> dict[str, Any]:
    metadata = tracks.metadata
    names = ("left_out", "tolerance_met", "worst_errors")
    return {
        "frames": len(tracks.frames),
        "fitted_lobes": metadata["lobes"],
        "lobes": tracks.lobes.count,
        **{name: metadata[name] for name in names},
    }


def table_rows(found: dict[str, dict[str, Any]]) -> list[list[str]]:
    """Return one row for each input, stills first, then by the number of lobes."""
    rows = []
    for name, one in sorted(found.items(), key=_order):
        rows.append(
            [
                name,
                str(one["frames"]),
                str(one["lobes"]),
                f"{one['judged']['irr']:.4f}",
                f"{one['judged']['r0.5']:.4f}",
                "yes" if one["tolerance_met"] else "no",
                str(one["left_out"]["one_sharpness"]),
                f"{one['cpu_seconds']:.0f}",
            ]
        )
    return rows


def _order(item: tuple[str, dict[str, Any]]) -> tuple[bool, int, str]:
    name, one = item
    return one["frames"] > 1, one["lobes"], name


def note(tolerance: float) -> str:
    """Say what the table shows."""
    return (
        f"The fewest lobes with which irr and r0.5 of every frame stay at or below {tolerance:g}, "
        "as `fit --tolerance` finds them. The errors are the judge's, the largest of any frame; "
        "`met` is what the fit itself says. Seconds are CPU seconds of the search and the fit; "
        "what another process takes to decode the images is not in them."
    )
