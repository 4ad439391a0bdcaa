# SPDX-License-Identifier: GPL-3.0-or-later
"""What is added to Blender, in order.

Blender takes it out again as it ends, which matters: 4.5 does not end while a hook is registered.
"""

import bpy

if not bpy.app.usd.supported:  # as Debian's
    raise ImportError(
        "asglight: this Blender was built without USD; expected a build with it, such as that of "
        "blender.org"
    )

bpy.utils.expose_bundled_modules()  # before `pxr` is imported anywhere

from . import fitting, hook, importing, panel, preferences, saving  # noqa: E402

CLASSES = (
    preferences.ASGLIGHT_AP_preferences,
    *importing.CLASSES,
    *fitting.CLASSES,
    *saving.CLASSES,
    *panel.CLASSES,
    hook.ASGLIGHT_USD_hook,
)


def register() -> None:
    """Register all classes and menus."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.TOPBAR_MT_file_import.append(importing.menu)


def unregister() -> None:
    """Take them out in the opposite order."""
    bpy.types.TOPBAR_MT_file_import.remove(importing.menu)
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
