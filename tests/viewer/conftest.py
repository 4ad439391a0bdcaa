# SPDX-License-Identifier: Apache-2.0
"""Windows, programs and lobes for the viewer's tests; neither a display nor a GPU is needed."""

import functools
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import moderngl
import pytest
import torch
import windows
import written_stages

from asglight import shader_files
from asglight.lobes import Form, Lobes, LobeTracks, frames
from asglight.sphere import latlong
from asglight.viewer.gl import glsl, passes


@pytest.fixture
def drive(opengl: moderngl.Context, two_lamps: LobeTracks) -> Iterator[windows.Drive]:
    """Open a window on two lamps, let a script drive it, close it."""
    if not sys.platform.startswith("linux"):
        pytest.skip("GLFW's null platform needs EGL, which Linux has")
    yield functools.partial(windows.drive, two_lamps)
    opengl.__enter__()  # so that the errors looked for afterwards are those of this context


@pytest.fixture
def probe_program(opengl: moderngl.Context, tmp_path: Path) -> Callable[[str], moderngl.Program]:
    """Compile a fragment shader given as text, with all of shaders/ to include from."""
    folder = shutil.copytree(shader_files.shader_folder(), tmp_path / "shaders")

    def compiled(text: str) -> moderngl.Program:
        (folder / "probe.frag").write_text(text)
        vertex = glsl.expanded(shader_files.VERTEX_SHADER)
        return glsl.program(opengl, vertex, glsl.expanded("probe.frag", passes.DEFINES, folder))

    return compiled


@pytest.fixture
def two_lamps() -> LobeTracks:
    """Two lobes over frames 1001, 1002 and 1004.

    A green one at u = 1/4, v = 1/4 that moves 1/8 of the map to the right from frame to frame, and
    a red one that rests at u = 3/4, v = 3/4.
    """
    green = torch.tensor([0.25, 0.375, 0.5])
    u = torch.stack([green, torch.full((3,), 0.75)], dim=-1)  # [F, N]
    v = torch.tensor([0.25, 0.75]).expand(3, 2)
    lobes = Lobes(
        axes=frames.axes_around(latlong.direction_from_uv(u, v)),
        sharpness=torch.full((3, 2, 2), 200.0),
        amplitude=torch.tensor([[0.0, 0.9, 0.0], [0.9, 0.0, 0.0]]).expand(3, 2, 3),
        form=Form.ASG,
    )
    return LobeTracks((1001, 1002, 1004), 24.0, lobes)


@pytest.fixture
def stage_of_two_lamps(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    """Write the two lamps as a stage."""
    written_stages.put(two_lamps, tmp_path / "shot.usda", dome_height=2)
    return tmp_path / "shot.usda"
