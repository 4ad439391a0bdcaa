# SPDX-License-Identifier: GPL-3.0-or-later
"""What is added to Blender, in order."""

import atexit

import bpy

bpy.utils.expose_bundled_modules()  # before `pxr` is imported anywhere

from . import hook, importing  # noqa: E402

CLASSES = (*importing.CLASSES, hook.ASGLIGHT_USD_hook)


def register() -> None:
    """Register all classes and menus."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.TOPBAR_MT_file_import.append(importing.menu)
    atexit.register(_unhook)


def unregister() -> None:
    """Take them out in the opposite order."""
    atexit.unregister(_unhook)
    bpy.types.TOPBAR_MT_file_import.remove(importing.menu)
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)


def _unhook() -> None:
    """Take the hook out as Blender ends: 4.5 as a Python module hangs where it is still there."""
    if hook.ASGLIGHT_USD_hook.is_registered:
        bpy.utils.unregister_class(hook.ASGLIGHT_USD_hook)
