# SPDX-License-Identifier: Apache-2.0
"""What a command is held against: its fit and its writing alone, with all loaded and read before.

    python -m benchmarks.command.parts fit FOLDER PRESET
    python -m benchmarks.command.parts growth ROWS FEW MANY

Prints seconds as JSON.
"""

import json
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.images import open_sequence
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.usd import write_usd
from benchmarks.command.frames import frame_of


def main(argv: Sequence[str]) -> int:
    """Measure one of the two."""
    what, *others = argv
    found = fit(*others) if what == "fit" else growth(*map(int, others))
    print(json.dumps(found))
    return 0


def fit(folder: str, preset: str) -> dict[str, float]:
    """Return the seconds of following a sequence from frame to frame, and of writing its stage."""
    sequence = open_sequence(folder, height=FIT_HEIGHT)
    maps = [sequence.read(frame).radiance for frame in sequence.frames]
    options = FitOptions(preset=Preset(preset))
    begin = time.perf_counter()
    fits = [fit_frame(maps[0], options, None)]
    for radiance in maps[1:]:
        earlier = fits[-2].lobes if len(fits) > 1 else None
        fits.append(fit_frame(radiance, options, fits[-1].lobes, earlier))
    fitted = time.perf_counter()
    tracks = LobeTracks(sequence.frames, 24.0, stack([each.lobes for each in fits]))
    with tempfile.TemporaryDirectory(prefix="asglight-") as own:
        write_usd(tracks, Path(own) / "shot.usda")  # loads what it needs
        begun = time.perf_counter()
        write_usd(tracks, Path(own) / "again.usda")
        return {"fit": fitted - begin, "write": time.perf_counter() - begun}


def growth(rows: int, few: int, many: int) -> dict[str, float]:
    """Return the seconds of `fast` on one map with few lobes and with many."""
    radiance = frame_of(0, rows)
    fit_frame(radiance, FitOptions(1), None)  # prepares the grids
    found = {}
    for name, count in (("few", few), ("many", many)):
        begin = time.process_time()
        fit_frame(radiance, FitOptions(count), None)
        found[name] = time.process_time() - begin
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
