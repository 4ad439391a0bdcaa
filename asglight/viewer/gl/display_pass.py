# SPDX-License-Identifier: Apache-2.0
"""The pass that knows the screen: linear radiance to colours (shaders/display.frag)."""

from collections.abc import Sequence
from typing import Any

import moderngl
import numpy as np

from asglight import shader_files
from asglight.viewer.colour import opencolorio
from asglight.viewer.gl.passes import Area, Picture, cover, pass_program
from asglight.viewer.state.display import ColourView, Comparison, Display, ViewTransform
from asglight.viewer.uniforms.shader_defines import SURROUND

STOPS_SCALE = "viridis"
"""matplotlib's name of the false-colour scale: even steps, also for colour-blind eyes."""

DIVERGING_SCALE = "berlin"
"""matplotlib's name of the scale of differences: dark where equal, red where the fit is larger,
blue where the reference is; a picture of small differences does not glare."""

_NO_SCALE = "none"

_DISPLAY_TEXTURES = (
    "u_scale",
    "u_fit",
    "u_fit_background",
    "u_reference",
    "u_reference_background",
)

_UNITS = len(_DISPLAY_TEXTURES)
"""Texture units that every view takes; tables of OpenColorIO follow."""


class DisplayPass:
    """Linear radiance -> exposure, view transform, sRGB (shaders/display.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Prepare the pass; a program is compiled when a view first needs it."""
        self._context = context
        self._triangles: dict[Any, moderngl.VertexArray] = {}
        self._scales: dict[str, moderngl.Texture] = {}
        self._tables: dict[ColourView, list[moderngl.Texture]] = {}

    def draw(
        self,
        fit: Picture,
        reference: Picture | None,
        display: Display,
        comparison: Comparison,
        target: moderngl.Framebuffer,
        *,
        gain_ev: float = 0.0,
        wipe: float = 0.5,
        area: Area | None = None,
        within: Sequence[Area] | None = None,
    ) -> None:
        """Draw one picture, or two compared, into a display target.

        Args:
            fit: Shown by FIT, and left of a wipe.
            reference: Shown by REFERENCE, and right of a wipe; not needed by FIT.
            display: How radiance is shown.
            comparison: Which of them; ROWS is two draws, of FIT and of REFERENCE.
            target: A display target.
            gain_ev: Stops added to the exposure: the environment's intensity.
            wipe: Share of the columns left of the wipe.
            area: Where in the target the picture lies; all of it by default.
            within: The parts of the area to draw: where there is no ball nothing needs to be; all
                of it by default.
        """
        compares = comparison in (Comparison.WIPE, Comparison.DIFFERENCE, Comparison.RATIO)
        first = reference if comparison is Comparison.REFERENCE else fit
        assert first is not None
        pictures = [first]
        area = area or (0, 0, *target.size)
        values: dict[str, Any] = {
            "u_area": tuple(map(float, area)),
            "u_exposure_ev": display.exposure_ev + gain_ev,
            "u_channel": shader_files.enum_number(display.channel),
            "u_zebra": display.zebra,
        }
        if compares:
            assert reference is not None
            pictures.append(reference)
            values |= {"u_comparison": shader_files.enum_number(comparison), "u_wipe": wipe}
        triangle = self._triangle(_special(pictures, display.transform, area), display.colour_view)
        self._scale(_scale_name(display, comparison)).use(location=0)
        for unit, picture in enumerate(pictures):
            picture.front.use(location=2 * unit + 1)
            # Without a background the front stands in: it is bound and not used.
            (picture.background or picture.front).use(location=2 * unit + 2)
        if display.transform is ViewTransform.OPENCOLORIO:
            for unit, table in enumerate(self._tables[display.colour_view], _UNITS):
                table.use(location=unit)
        for name, value in values.items():
            if name in triangle.program:  # a view leaves out what it has no use for
                triangle.program[name] = value
        for part in (area,) if within is None else within:
            cover(self._context, triangle, target, part)

    def _triangle(self, special: dict[str, int], view: ColourView) -> moderngl.VertexArray:
        """Return the program of a view, with what it draws; compile it if it is new."""
        is_ocio = special["TRANSFORM"] == shader_files.enum_number(ViewTransform.OPENCOLORIO)
        key = (*special.items(), view if is_ocio else None)
        if key not in self._triangles:
            shader = opencolorio.view_shader(view) if is_ocio else opencolorio.ViewShader("", ())
            program = pass_program(self._context, "display.frag", special, shader.text)
            for unit, name in enumerate(_DISPLAY_TEXTURES):
                if name in program:
                    program[name] = unit
            for unit, table in enumerate(shader.tables, _UNITS):
                if table.sampler in program:  # a driver leaves out what a view has no use for
                    program[table.sampler] = unit
            if view not in self._tables:
                self._tables[view] = [self._uploaded(table) for table in shader.tables]
            if "u_surround" in program:  # a background leaves no room for it
                program["u_surround"] = SURROUND
            self._triangles[key] = self._context.vertex_array(program, [])
        return self._triangles[key]

    def _uploaded(self, table: opencolorio.Table) -> moderngl.Texture:
        """Return a table of OpenColorIO as a texture."""
        *sizes, channels = table.values.shape
        size = tuple(reversed(sizes))
        make: Any = self._context.texture3d if len(size) == 3 else self._context.texture
        texture = make(size, channels, table.values.tobytes(), alignment=1, dtype="f4")
        way = moderngl.LINEAR if table.is_linear else moderngl.NEAREST
        texture.filter = way, way
        texture.repeat_x = texture.repeat_y = False
        return texture

    def _scale(self, name: str) -> moderngl.Texture:
        """Return a colour scale of matplotlib as one row of sRGB."""
        if name not in self._scales:
            colours = scale_colours(name)
            texture = self._context.texture((len(colours), 1), 3, colours.tobytes(), alignment=1)
            texture.repeat_x = False
            self._scales[name] = texture
        return self._scales[name]


def scale_colours(name: str) -> np.ndarray:
    """Return 256 sRGB colours of a colour scale, 8 bits; one grey where none is needed.  [., 3]."""
    if name == _NO_SCALE:
        return np.zeros((1, 3), np.uint8)
    import matplotlib  # slow to import, and needed for false colour only

    return matplotlib.colormaps[name](np.arange(256), bytes=True)[:, :3].copy()


def _special(pictures: Sequence[Picture], transform: ViewTransform, area: Area) -> dict[str, int]:
    """Return what a program of shaders/display.frag is compiled for."""
    special = {"TRANSFORM": shader_files.enum_number(transform)}
    if len(pictures) > 1:
        special["COMPARES"] = 1
    layers = [picture.front for picture in pictures]
    backgrounds = [picture.background for picture in pictures if picture.background is not None]
    if len(backgrounds) == len(pictures):
        special["BACKGROUND"] = 1
        layers += backgrounds
    if all(layer.size == area[2:] for layer in layers):
        special["EXACT"] = 1
    return special


def _scale_name(display: Display, comparison: Comparison) -> str:
    if comparison in (Comparison.DIFFERENCE, Comparison.RATIO):
        return DIVERGING_SCALE
    return STOPS_SCALE if display.transform is ViewTransform.FALSE_COLOUR else _NO_SCALE
