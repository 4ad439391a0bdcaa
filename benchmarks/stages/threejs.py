# SPDX-License-Identifier: Apache-2.0
"""Read stages with three.js' USDLoader in Chromium and hold its lights against the stages.

    python -m benchmarks.stages.threejs FOLDER [STAGE ...]

FOLDER holds three.js unpacked (`npm pack three@0.187.0 && tar xf three-0.187.0.tgz`). Without STAGE
it reads a moving shot of five lobes that is written for it, as cards and as distant lights, and the
smallest file that shows each fault. A row is a stage at a time: lights that are there of those that
shine, how far they stand from where they should (degrees, and times the distance), how far they are
turned (degrees), and their light over what it should be.
"""

import argparse
import functools
import http.server
import math
import shutil
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux

from asglight.usd import Representation, write_usd

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from chromium import Page, chromium
from usd_tracks import moving

PAGE = Path(__file__).with_suffix(".html")

FAULTS = {
    "suffix": """#usda 1.0
(
    upAxis = "Y"
)
def RectLight "light" {
    double3 xformOp:translate:dist = (0, 0, 10)
    uniform token[] xformOpOrder = ["xformOp:translate:dist"]
}
""",
    "sun": """#usda 1.0
(
    upAxis = "Y"
)
def DistantLight "light" {
    float inputs:intensity = 1
    float3 xformOp:rotateXYZ = (0, 90, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}
""",
    "moving": """#usda 1.0
(
    upAxis = "Y"
    startTimeCode = 0
    endTimeCode = 24
    timeCodesPerSecond = 24
)
def RectLight "light" {
    float inputs:intensity = 1
    float inputs:intensity.timeSamples = { 0: 1, 24: 3 }
    double3 xformOp:translate = (0, 0, 10)
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 10), 24: (10, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
""",
}
"""Stages of one light that the loader shows wrongly, each for one reason."""


class Light(NamedTuple):
    """A light at a time.

    Attributes:
        place: Where it stands.  [3]
        direction: Where it shines, unit.  [3]
        light: Colour times intensity.  [3]
    """

    place: np.ndarray
    direction: np.ndarray
    light: np.ndarray


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("stages", type=Path, nargs="*")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "package").symlink_to((arguments.folder / "package").resolve())
        shutil.copy(PAGE, folder / "index.html")
        paths = [Path(shutil.copy(path, folder)) for path in arguments.stages] or written(folder)
        print("stage          time  lights  place (deg, x)  turned (deg)  light x")
        with served(folder) as root, chromium() as page:
            page.ask("Page.navigate", url=f"{root}/index.html")
            page.wait("window.ready")
            for path in paths:
                for row in rows(page, root, path):
                    print(row)


def written(folder: Path) -> list[Path]:
    """Write the stages that are read without others."""
    paths = []
    tracks = moving(range(1001, 1005), 5)
    for kind in (Representation.CARDS, Representation.DISTANT):
        for suffix in ("usda", "usdz"):
            paths.append(folder / f"{kind}.{suffix}")
            write_usd(tracks, paths[-1], representations=(kind,))
    for name, text in FAULTS.items():
        paths.append(folder / f"{name}.usda")
        paths[-1].write_text(text)
    return paths


class served:  # noqa: N801 - read as the words of a `with` statement
    """A folder as pages: modules of JavaScript are not loaded from files."""

    def __init__(self, folder: Path) -> None:
        """Take a free port of this machine."""
        handler = functools.partial(_Quiet, directory=str(folder))
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)

    def __enter__(self) -> str:
        """Serve, and return where."""
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{self._server.server_port}"

    def __exit__(self, *_: object) -> None:
        """End."""
        self._server.shutdown()
        self._server.server_close()


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


def rows(page: Page, root: str, path: Path) -> list[str]:
    """Return the rows of a stage, at its first, a middle and its last time."""
    stage = Usd.Stage.Open(str(path))
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    times = sorted({first, round((first + last) / 2), last})
    seconds = [time / stage.GetTimeCodesPerSecond() for time in times]
    found = page.run(f"lights({f'{root}/{path.name}'!r}, {seconds})")
    shown = []
    for time, lights in zip(times, found, strict=True):
        by_name = {
            one["name"]: Light(*(np.array(one[key]) for key in ("place", "direction", "light")))
            for one in lights
        }
        wanted = lights_of(stage, time)
        there = [(light, by_name[name]) for name, light in wanted.items() if name in by_name]
        shown.append(f"{path.name:<14} {time:<5g} {len(there)} of {len(wanted)}  {judged(there)}")
    return shown


def lights_of(stage: Usd.Stage, time: float) -> dict[str, Light]:
    """Return the lights of a stage that shine at a time, by their prim's name."""
    cache = UsdGeom.XformCache(time)
    lights = {}
    for prim in stage.Traverse():
        if not (prim.IsA(UsdLux.RectLight) or prim.IsA(UsdLux.DistantLight)):
            continue
        matrix = cache.GetLocalToWorldTransform(prim)
        api = UsdLux.LightAPI(prim)
        lights[prim.GetName()] = Light(
            np.array(matrix.ExtractTranslation()),
            np.array(matrix.TransformDir(Gf.Vec3d(0, 0, -1)).GetNormalized()),
            np.array(api.GetColorAttr().Get(time)) * api.GetIntensityAttr().Get(time),
        )
    return {name: one for name, one in lights.items() if one.light.any()}


def judged(pairs: Sequence[tuple[Light, Light]]) -> str:
    """Return the worst of some lights: wanted, found."""
    if not pairs:
        return ""
    places = [(a.place, b.place) for a, b in pairs if np.linalg.norm(a.place) > 0]
    away = max((angle(a, b) for a, b in places), default=0.0)
    far = [float(np.linalg.norm(b) / np.linalg.norm(a)) for a, b in places] or [1.0]
    turned = max(angle(a.direction, b.direction) for a, b in pairs)
    light = [float(b.light.sum() / a.light.sum()) for a, b in pairs]
    return (
        f"{away:5.1f}, {min(far):.2f} to {max(far):.2f}  {turned:5.1f}  "
        f"{min(light):.2f} to {max(light):.2f}"
    )


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Return the degrees between two vectors; 180 where one has no length."""
    lengths = np.linalg.norm(a) * np.linalg.norm(b)
    return math.degrees(math.acos(np.clip(a @ b / lengths, -1, 1))) if lengths > 0 else 180.0


if __name__ == "__main__":
    main()
