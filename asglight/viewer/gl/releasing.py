# SPDX-License-Identifier: Apache-2.0
"""What layers and passes have made on the GPU, freed: moderngl frees nothing by itself.

Queries stay, a number each: it has no way to free them.
"""

from typing import Any

import moderngl

_ROOM = "asglight.viewer.gl"

_MADE = (
    moderngl.Buffer,
    moderngl.Framebuffer,
    moderngl.Program,
    moderngl.Texture,
    moderngl.Texture3D,
    moderngl.VertexArray,
)


def release(owner: object) -> None:
    """Free what an object of this room holds, and what the objects that it holds do.

    Args:
        owner: It must not draw any more, and none of its targets be bound.
    """
    seen: set[int] = set()
    waiting: list[Any] = [owner]
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, _MADE):
            if isinstance(one, moderngl.VertexArray):
                waiting.append(one.program)
            elif isinstance(one, moderngl.Framebuffer):
                waiting.extend(one.color_attachments or ())  # none when it was freed
            one.release()
        elif isinstance(one, dict):
            waiting.extend(one.values())
        elif isinstance(one, list | tuple):
            waiting.extend(one)
        elif type(one).__module__.startswith(_ROOM):
            waiting.extend(vars(one).values())
