# SPDX-License-Identifier: Apache-2.0
"""The system's own dialog for naming a file, where there is one."""

import os
import shutil
import sys

from imgui_bundle import portable_file_dialogs as dialogs

from asglight.viewer.io.wanted import SUFFIXES
from asglight.viewer.state.views import RENDERS, Request

_PROGRAMS = ("zenity", "kdialog", "qarma", "matedialog")
"""What draws a dialog on Linux; Windows and macOS draw their own."""


def has_dialog() -> bool:
    """Tell whether the system can ask for the name of a file."""
    if not sys.platform.startswith("linux"):
        return True
    has_screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return has_screen and any(map(shutil.which, _PROGRAMS))


def save_dialog(request: Request, path: str, suffix: str) -> dialogs.save_file:
    """Ask under which name to save; the answer comes later.

    Args:
        request: What is saved.
        path: The name that is proposed.
        suffix: What it ends with.
    """
    title = "Save the edits" if request is Request.SAVE_EDITS else "Save the picture"
    kinds = [suffix.strip(".").upper(), f"*{suffix}"]
    if request in RENDERS:
        title = "Render"
        kinds = ["Pictures and films", " ".join(f"*{kind}" for kind in SUFFIXES)]
    return dialogs.save_file(title, path, kinds)
