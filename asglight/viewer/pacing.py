# SPDX-License-Identifier: Apache-2.0
"""When the next picture of a shot that plays is due."""

import time

import imgui_bundle  # noqa: F401  before glfw: the first of the two decides whose GLFW both use

import glfw  # isort: skip

from asglight.viewer.state.viewer_state import ViewerState


def wait_for_frame(state: ViewerState) -> None:
    """While a shot plays, wait for its next frame or for an event of the user.

    Without a GPU a picture takes about as long as a frame is shown: one more of the same frame
    would make the next one late.
    """
    seconds = state.playback.seconds_to_next(state.clock())
    if not seconds:
        return
    if glfw.get_platform() == glfw.PLATFORM_NULL:  # it has no events to wait for
        time.sleep(seconds)
    else:
        glfw.wait_events_timeout(seconds)
