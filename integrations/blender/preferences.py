# SPDX-License-Identifier: GPL-3.0-or-later
"""The preferences of the extension."""

import shutil

import bpy
from bpy.props import StringProperty


class ASGLIGHT_AP_preferences(bpy.types.AddonPreferences):  # noqa: N801 - Blender's way
    """Where the `asglight` command is."""

    bl_idname = __package__
    command: StringProperty(
        name="asglight command",
        subtype="FILE_PATH",
        default="",
        description="The command that `pip install asglight` made; found by itself if on the PATH",
    )

    def draw(self, _: bpy.types.Context) -> None:
        """Draw the path, and what is found without one."""
        self.layout.prop(self, "command")
        if not self.command:
            found = shutil.which("asglight")
            words = f"found: {found}" if found else "not on the PATH; fitting needs it"
            self.layout.label(text=words, icon="INFO" if found else "ERROR")


def command() -> str:
    """Return the command.

    Raises:
        ValueError: There is none.
    """
    addon = bpy.context.preferences.addons.get(__package__)
    chosen = bpy.path.abspath(addon.preferences.command) if addon is not None else ""
    found = chosen or shutil.which("asglight")
    if not found:
        raise ValueError(
            "asglight: no such command; expected it on the PATH, or its path in Edit > "
            "Preferences > Add-ons > asglight"
        )
    return found
