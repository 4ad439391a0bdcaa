# SPDX-License-Identifier: Apache-2.0
"""An OpenGL context without a window, what to say without one, and how what it makes is freed."""

import sys
from typing import Any

import moderngl

from asglight.errors import InputError

GL_VERSION = (4, 1)
"""The newest OpenGL that macOS has; Windows and Linux drivers have it too."""

_LOWEST = 210
"""Asked for only to find out what a machine has that lacks GL_VERSION."""

_SYSTEM_PACKAGES = "On Debian or Ubuntu: apt install libegl1 libgl1."


def standalone_context() -> moderngl.Context:
    """Open an off-screen context: on Linux through EGL, which needs no display.

    Raises:
        InputError: There is no OpenGL, or an older one than GL_VERSION.
    """
    major, minor = GL_VERSION
    try:
        return collects(_open(100 * major + 10 * minor))
    except Exception as error:  # glcontext raises plain Exception
        raise InputError(_why_not(error)) from error


def describe(context: moderngl.Context) -> str:
    """Return the OpenGL version and the renderer of a context, in one line."""
    return f"OpenGL {context.info['GL_VERSION']}, {context.info['GL_RENDERER']}"


def no_opengl(finding: object) -> str:
    """Return the message for a machine whose OpenGL libraries cannot be used."""
    text = " ".join(str(finding).split()).rstrip(".")
    return f"OpenGL: {text}; expected OpenGL {_wanted()} or later. {_SYSTEM_PACKAGES}"


def _open(version: int) -> moderngl.Context:
    # Elsewhere the default backend needs no display either.
    options: dict[str, Any] = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    return moderngl.create_context(standalone=True, require=version, **options)


def _why_not(error: Exception) -> str:
    """Tell an OpenGL that is too old from none at all; drivers give no usable error for either."""
    try:
        older = _open(_LOWEST)
    except Exception:  # glcontext raises plain Exception
        return no_opengl(error)
    found = describe(older)
    older.release()
    return f"OpenGL: found {found}; expected {_wanted()} or later. Update the graphics driver."


def _wanted() -> str:
    return ".".join(map(str, GL_VERSION))


def collects(context: moderngl.Context) -> moderngl.Context:
    """Let a context gather what nobody holds any more, for `context.gc()` to free.

    Python may drop an object in any thread, and OpenGL frees it only in that of its context. What a
    context makes must not be freed by hand, with `release()`: `gc()` would fail on it.
    """
    context.gc_mode = "context_gc"
    return context
