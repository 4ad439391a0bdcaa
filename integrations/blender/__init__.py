# SPDX-License-Identifier: GPL-3.0-or-later
"""asglight in Blender: stages imported with everything that moves, and edits written back.

`bpy` is loaded when Blender registers the extension and not before, so that the files that need
none of it can be used, and tested, elsewhere.
"""


def register() -> None:
    """Add all to Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Take all out again."""
    from . import registration

    registration.unregister()
