# SPDX-License-Identifier: Apache-2.0
"""The GPU passes: arguments in, a drawn target out. No pass keeps the viewer's state.

Targets keep row 0 of the image in row 0 of the texture (shaders/README.md), so reading one back
gives the image's rows from the top.

Symbols: N lobes; H, W rows and columns of a target, sizes written (W, H) as OpenGL does.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import moderngl
import numpy as np

from asglight import shader_files
from asglight.lobes import Lobes
from asglight.viewer.gl import glsl
from asglight.viewer.state.display import Comparison, Display, ViewTransform
from asglight.viewer.state.viewer_state import MAX_LOBES
from asglight.viewer.uniforms.shader_defines import DEFINES, SURROUND

STOPS_SCALE = "viridis"
"""matplotlib's name of the false-colour scale: even steps, also for colour-blind eyes."""

DIVERGING_SCALE = "berlin"
"""matplotlib's name of the scale of differences: dark where equal, red where the fit is larger, blue
where the reference is; a picture of small differences does not glare."""

_NO_SCALE = "none"

_DISPLAY_TEXTURES = (
    "u_scale",
    "u_fit",
    "u_fit_background",
    "u_reference",
    "u_reference_background",
)

Area = tuple[int, int, int, int]
"""x, y, columns and rows of a part of a target; row 0 is the top."""

_HEADER = np.dtype([("count", "<i4"), ("form", "<i4"), ("padding", "<i4", 2)])
_LOBE = np.dtype(
    [
        ("axis_x", "<f4", 3),
        ("sharpness_x", "<f4"),
        ("axis_y", "<f4", 3),
        ("sharpness_y", "<f4"),
        ("axis_z", "<f4", 4),
        ("amplitude", "<f4", 4),
    ]
)
_BLOCK_BYTES = _HEADER.itemsize + MAX_LOBES * _LOBE.itemsize


def pass_program(
    context: moderngl.Context, fragment: str, special: Mapping[str, float] | None = None
) -> moderngl.Program:
    """Compile the pass of a fragment shader in shaders/, with constants of one scene if any."""
    vertex = glsl.expanded(shader_files.VERTEX_SHADER)
    return glsl.program(context, vertex, glsl.expanded(fragment, {**DEFINES, **(special or {})}))


def radiance_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for linear radiance, RGBA32F: half floats end below a sun."""
    return context.framebuffer([context.texture(size, 4, dtype="f4")])


def display_target(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Framebuffer:
    """Return a target for sRGB, RGBA8."""
    return context.framebuffer([context.texture(size, 4)])


def target_texture(target: moderngl.Framebuffer) -> moderngl.Texture:
    """Return the texture that a target draws into."""
    (texture,) = target.color_attachments
    assert isinstance(texture, moderngl.Texture)
    return texture


def release_target(target: moderngl.Framebuffer) -> None:
    """Free a target with its texture."""
    texture = target_texture(target)
    target.release()
    texture.release()


def packed_lobes(lobes: Lobes) -> bytes:
    """Lay lobes out as LobesBlock of shaders/lobes_block.glsl (std140).

    Args:
        lobes: At most MAX_LOBES.  [N, .]
    """
    assert lobes.count <= MAX_LOBES, lobes.count
    header = np.zeros(1, _HEADER)
    header["count"] = lobes.count
    header["form"] = shader_files.enum_number(lobes.form)
    block = np.zeros(lobes.count, _LOBE)
    values = lobes.to("cpu")
    for name in ("axis_x", "axis_y", "axis_z", "amplitude"):
        block[name][:, :3] = getattr(values, name).detach().numpy()
    block["sharpness_x"], block["sharpness_y"] = values.sharpness.detach().numpy().T
    return header.tobytes() + block.tobytes()


class LobesPass:
    """Sum of lobes -> linear radiance, a latlong map (shaders/lobes.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        self._context = context
        self._program = pass_program(context, "lobes.frag")
        self._program["LobesBlock"].binding = 0
        self._triangle = context.vertex_array(self._program, [])
        self._block = context.buffer(reserve=_BLOCK_BYTES)

    def draw(self, lobes: Lobes, target: moderngl.Framebuffer) -> None:
        """Draw the radiance of N lobes at the centre of each texel of a radiance target."""
        self._block.write(packed_lobes(lobes))
        self._block.bind_to_uniform_block(0)
        self._program["u_size"] = target.size
        cover(self._context, self._triangle, target)


class BackgroundPass:
    """A latlong map -> the radiance behind the balls (shaders/background.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the pass."""
        self._context = context
        self._program = pass_program(context, "background.frag")
        self._program["u_latlong"] = 0
        self._triangle = context.vertex_array(self._program, [])

    def draw(
        self,
        latlong: moderngl.Texture,
        camera_from_environment: np.ndarray,
        target: moderngl.Framebuffer,
    ) -> None:
        """Draw a latlong map, 90 degrees of it across a radiance target, as a camera sees it.

        Args:
            latlong: Radiance, filtered linearly, repeating in columns.
            camera_from_environment: A rotation.  [3, 3]
            target: A radiance target.
        """
        latlong.use(location=0)
        self._program["u_size"] = target.size
        # OpenGL stores columns
        self._program["u_camera_from_environment"].write(
            camera_from_environment.T.astype("f4").tobytes()
        )
        cover(self._context, self._triangle, target)


class Picture(NamedTuple):
    """Linear radiance to be shown, of any size.

    Attributes:
        front: RGB multiplied by the coverage in alpha.
        background: What shows through, or None.
    """

    front: moderngl.Texture
    background: moderngl.Texture | None = None


class DisplayPass:
    """Linear radiance -> exposure, view transform, sRGB (shaders/display.frag)."""

    def __init__(self, context: moderngl.Context) -> None:
        """Prepare the pass; a program is compiled when a view first needs it."""
        self._context = context
        self._triangles: dict[tuple[tuple[str, int], ...], moderngl.VertexArray] = {}
        self._scales: dict[str, moderngl.Texture] = {}

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
        triangle = self._triangle(_special(pictures, display.transform, area))
        self._scale(_scale_name(display, comparison)).use(location=0)
        for unit, picture in enumerate(pictures):
            picture.front.use(location=2 * unit + 1)
            # Without a background the front stands in: it is bound and not used.
            (picture.background or picture.front).use(location=2 * unit + 2)
        for name, value in values.items():
            if name in triangle.program:  # a view leaves out what it has no use for
                triangle.program[name] = value
        for part in (area,) if within is None else within:
            cover(self._context, triangle, target, part)

    def _triangle(self, special: dict[str, int]) -> moderngl.VertexArray:
        """Return the program of a view, with what it draws; compile it if it is new."""
        key = tuple(special.items())
        if key not in self._triangles:
            program = pass_program(self._context, "display.frag", special)
            for unit, name in enumerate(_DISPLAY_TEXTURES):
                if name in program:
                    program[name] = unit
            if "u_surround" in program:  # a background leaves no room for it
                program["u_surround"] = SURROUND
            self._triangles[key] = self._context.vertex_array(program, [])
        return self._triangles[key]

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


def cover(
    context: moderngl.Context,
    triangle: moderngl.VertexArray,
    target: moderngl.Framebuffer,
    area: Area | None = None,
) -> None:
    """Draw over a target or an area of it, whatever state the last user of the context left."""
    target.use()
    context.enable_only(moderngl.NOTHING)
    target.viewport = area or (0, 0, *target.size)
    triangle.render(moderngl.TRIANGLES, vertices=3)
