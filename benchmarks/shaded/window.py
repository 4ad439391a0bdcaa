# SPDX-License-Identifier: Apache-2.0
"""Measure the whole window: playing, idle, a reference at rest, and the first picture.

The window is the real one on GLFW's null platform, 1600 x 1000, with every panel; each case is a
process of its own. The null platform has no events to wait for, so that idle is the CPU time of a
picture, as often as an idle window draws one.

On a machine that does other things, CPU time is what counts, of all threads together: two cores
give 83 ms of it to each of 24 frames a second.

    python -m benchmarks.shaded.window day.usda --reference ../shared/sequences/day
"""

import argparse
import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

CASES = {
    "play": "playing, 15 lobes",
    "compare": "playing, 15 lobes, with reference",
    "many": "playing, 60 lobes",
    "ground": "playing, 15 lobes, on the ground",
    "idle": "idle",
    "rest": "reference at rest, to its last sample",
    "first": "first picture, from the start of the command",
}
LOBES, MANY = 15, 60
WARM_S, MEASURED_S, REST_S = 3.0, 6.0, 60.0


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stage", type=Path)
    parser.add_argument("--reference", required=True, help="images of the stage")
    parser.add_argument("--cases", nargs="*", choices=CASES, default=list(CASES))
    parser.add_argument("--case", choices=CASES, help=argparse.SUPPRESS)
    options = parser.parse_args(argv)
    if options.case:
        print(measured(options.case, options.stage, options.reference))
        return
    print("| case | frames/s | pictures/s | CPU ms a picture | cores busy | s | CPU s |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for case in options.cases:
        command = [sys.executable, "-m", "benchmarks.shaded.window", str(options.stage)]
        command += ["--reference", options.reference, "--case", case]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        print(f"| {CASES[case]} | {done.stdout.strip() or failure(done)} |", flush=True)


def failure(done: subprocess.CompletedProcess[str]) -> str:
    """Say why a case has no numbers: what it said last, or how it ended."""
    said = done.stderr.strip().splitlines()
    return f"failed: {said[-1] if said else f'said nothing, status {done.returncode}'}"


def measured(case: str, stage: Path, reference: str) -> str:
    """Return the cells of a case's line."""
    if case == "first":
        return _first(stage)
    from imgui_bundle import hello_imgui, immapp

    from asglight.cli.sources.opening import Request, opened
    from asglight.viewer import app, running, window
    from asglight.viewer.io import screenshot
    from asglight.viewer.state.views import Scene

    images = reference if case in ("compare", "rest") else None
    session = opened(Request(str(stage), images))
    app.set_up(session, None, None)
    session.wait()  # what the stage brings comes first, else it would take the place of the copies
    _with_lobes(session.state, MANY if case == "many" else LOBES)
    if case == "ground":
        session.state.scene = Scene.GROUND
    screenshot.use_no_display()

    class Measured(window.Window):
        """Plays, counts pictures and ends."""

        began = time.monotonic()
        counting: Any = None
        cells = ""

        def before_picture(self) -> None:
            super().before_picture()
            now, playback = time.monotonic(), self.state.playback
            if self.counting is None:
                if case == "rest":
                    self.counting = [now, time.process_time(), 0, 0, playback.frame]
                elif now - self.began > WARM_S:
                    if case != "idle":
                        playback.play(self.state.clock())
                    self.counting = [now, time.process_time(), 0, 0, playback.frame]
                return
            start, cpu, _, _, before = self.counting
            self.counting[2] += 1
            self.counting[3] += playback.frame != before
            self.counting[4] = playback.frame
            seconds, used = now - start, time.process_time() - cpu
            is_over = seconds > MEASURED_S
            if case == "rest":
                has_ended = self.renderer.reference_progress >= 1 and self.counting[2] > 5
                is_over = has_ended or seconds > REST_S
            if not is_over or self.cells:
                return
            pictures, frames = self.counting[2], self.counting[3]
            each = [f"{frames / seconds:.1f}", f"{pictures / seconds:.1f}"]
            each += [f"{1e3 * used / pictures:.0f}", f"{used / seconds:.2f}"]
            if case in ("idle", "rest"):
                each[0] = ""
            if case == "idle":  # the null platform does not sleep: as often as an idle window draws
                each[1] = f"{running.FPS_IDLE:g}"
                each[3] = f"{running.FPS_IDLE * used / pictures:.3f}"
            self.cells = " | ".join([*each, f"{seconds:.1f}", f"{used:.1f}"])
            hello_imgui.get_runner_params().app_shall_exit = True

    shown = Measured(session, lambda _path: None)
    params = running.runner_params(shown, running.SIZE)
    params.ini_disable = True
    with running.as_pictures_need():
        immapp.run(params, immapp.AddOnsParams(with_implot=True))
    shown.raise_failure()
    session.close()
    return shown.cells


def _with_lobes(state: Any, count: int) -> None:
    """Show so many lobes: the brightest of the shot, and turned copies where there are too few."""
    import torch

    from asglight.lobes import LobeTracks, asg

    tracks = state.tracks
    power = asg.flux(tracks.lobes).sum((0, 2))
    lobes = tracks.lobes.select(power.argsort(descending=True)[: min(count, len(power), LOBES)])
    parts = [lobes]
    while sum(part.count for part in parts) < count:
        angle = torch.tensor(2.4 * len(parts), dtype=torch.float64)  # apart from each other
        turn = torch.zeros(3, 3, dtype=torch.float64)
        turn[0, 0] = turn[2, 2] = torch.cos(angle)
        turn[0, 2], turn[2, 0], turn[1, 1] = torch.sin(angle), -torch.sin(angle), 1.0
        parts.append(asg.rotate(lobes.to(torch.float64), turn).to(torch.float32))
    joined = type(lobes)(
        torch.cat([part.axes for part in parts], 1),
        torch.cat([part.sharpness for part in parts], 1),
        torch.cat([part.amplitude for part in parts], 1),
        lobes.form,
    )
    state.replace_tracks(LobeTracks(tracks.frames, tracks.fps, joined))


def _first(stage: Path) -> str:
    """Return the cells of the first picture: seconds and CPU seconds since the process began."""
    code = "import benchmarks.shaded.window as w, sys; w.first_picture(sys.argv[1])"
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", code, str(stage)], capture_output=True, text=True, check=False
    )
    found = done.stdout.split()
    if done.returncode or len(found) != 2:
        raise SystemExit(f"first picture: {failure(done)}")
    used, ended = map(float, found)
    return f" | | | | {ended - start:.1f} | {used:.1f}"


def first_picture(stage: str) -> None:
    """Run `asglight view` up to its first picture; print CPU seconds and the clock then."""
    from asglight.cli.main import main as command
    from asglight.viewer import app

    def show(session: Any, _opener: Callable[..., Any], size: Any) -> None:
        from imgui_bundle import hello_imgui, immapp

        from asglight.viewer import running, window
        from asglight.viewer.io import screenshot

        class First(window.Window):
            """Ends after its first picture."""

            pictures = 0

            def before_picture(self) -> None:
                super().before_picture()
                self.pictures += 1
                if self.pictures == 2:  # the first has been drawn
                    self.context.finish()
                    print(time.process_time(), time.monotonic(), flush=True)
                    hello_imgui.get_runner_params().app_shall_exit = True

        screenshot.use_no_display()
        params = running.runner_params(First(session, lambda _path: None), size or running.SIZE)
        params.ini_disable = True
        with running.as_pictures_need():
            immapp.run(params, immapp.AddOnsParams(with_implot=True))

    app.show = show
    with contextlib.suppress(SystemExit):
        command(["view", stage])


if __name__ == "__main__":
    main()
