# SPDX-License-Identifier: Apache-2.0
"""Keeps the inspector's numbers those of the frame, the edits and the view that are shown."""

from asglight.viewer.gl.arrangement import cells, hit, strip
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.state.inspector import inspect_ball, inspect_map
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Scene


def inspect(state: ViewerState, renderer: Renderer, size: tuple[int, int]) -> None:
    """Read anew what lies at the probe; to be called with every picture of the balls.

    A ball's radiance is read from the GPU, which waits for it: while something moves there is none
    to be shown.

    Args:
        state: Its `inspected` is set.
        renderer: What has drawn the balls.
        size: Columns and rows of their picture, in points.
    """
    probe = state.probe
    if probe is None:
        return
    if probe.place == "map":
        state.inspected = inspect_map(state, probe.x, probe.y)
        return
    if state.scene is Scene.GROUND:
        state.inspected = state.probe = None
        return
    columns, rows = size
    rows = strip(rows, state.parts).rows
    found = hit(cells((columns, rows), len(state.balls)), probe.x * columns, probe.y * rows)
    if found is None:  # the balls lie elsewhere now
        state.inspected = state.probe = None
        return
    fit = reference = None
    if not state.is_moving:
        fit, reference = renderer.probed(probe.x, probe.y)
    state.inspected = inspect_ball(state, state.balls[found.ball].name, found, fit, reference)
