# SPDX-License-Identifier: GPL-3.0-or-later
"""What the hook and the importer share: stages opened, Blender's colours, words of warning."""

import bpy
from pxr import Usd

from .plain import colours
from .plain.rigs import Rig, read_rig, rig_prims


def working_space() -> str:
    """Return the Color Interop ID of the colours that Blender calculates with."""
    settings = getattr(bpy.data, "colorspace", None)  # since Blender 5.0 a file may choose
    chosen = getattr(settings, "working_space", "Linear Rec.709")
    names = {name: space for space, name in colours.BLENDER_NAMES.items()}
    return names.get(chosen, colours.REC709)


def rigs_of(stage: Usd.Stage, space: str) -> list[Rig]:
    """Return all rigs of a stage as they are shown.

    The stage that Blender's importer hands over holds values from sample to sample; lights are
    linear between them.
    """
    kept = stage.GetInterpolationType()
    stage.SetInterpolationType(Usd.InterpolationTypeLinear)
    try:
        return [read_rig(prim, space) for prim in rig_prims(stage)]
    finally:
        stage.SetInterpolationType(kept)


class Warned:
    """Words about light that Blender cannot show as the stage says."""

    def __init__(self) -> None:
        """Start with none."""
        self.lines: list[str] = []

    def say(self, line: str) -> None:
        """Add a line, once."""
        if line not in self.lines:
            self.lines.append(line)

    def about(self, rig: Rig) -> None:
        """Add what is known of a rig."""
        if rig.left:
            self.say(f"not taken over, no light that asglight writes: {', '.join(rig.left)}")
        textured = [lamp.path for lamp in rig.lamps if lamp.texture]
        if textured:
            self.say(
                f"{len(textured)} cards have a texture, which Blender's lights leave out: they are "
                "wider than they should be; export the stage without --card-texture"
            )
        if rig.colourspace not in colours.CHROMATICITIES:
            self.say(f"colours are taken for Rec.709; {rig.colourspace} is unknown here")
        elif rig.domes and rig.colourspace not in colours.BLENDER_NAMES:
            self.say(f"images of the dome are taken for Rec.709; Blender has no {rig.colourspace}")

    def show(self) -> None:
        """Print the lines, and show them where there is a window."""
        for line in self.lines:
            print(f"asglight: {line}")
        lines = list(self.lines)
        if not lines or bpy.app.background or bpy.context.window_manager is None:
            return

        def draw(menu: bpy.types.Menu, _: bpy.types.Context) -> None:
            for line in lines:
                menu.layout.label(text=line)

        bpy.context.window_manager.popup_menu(draw, title="asglight", icon="ERROR")
