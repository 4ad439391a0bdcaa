# SPDX-License-Identifier: Apache-2.0
"""OpenColorIO views of linear Rec.709 radiance: configs, displays, views, and their GLSL.

Configs are ACES ones that the library carries, and the studio's, which the environment variable
OCIO names. The library writes the shader; the tables that it looks up come with it.
"""

import functools
import os
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import PyOpenColorIO

from asglight.errors import InputError
from asglight.viewer.state.display import ColourView, ViewTransform

BUILT_IN: Mapping[str, str] = {
    "ACES 2.0": "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5",
    "ACES 1.3": "ocio://cg-config-v2.2.0_aces-v1.3_ocio-v2.4",
}
"""Names of configs, and where the library has them."""

STUDIO = "$OCIO"
"""Name of the config that the environment variable names."""

FUNCTION = "ocio_display"
"""Name of the shader's function: vec4 to vec4."""

_LINEAR_REC709 = "Linear Rec.709 (sRGB)"
"""What the radiance is, as the ACES configs call it."""

_INTERCHANGE = "ACES2065-1"
"""What every config can come from, if it names its colour space in a role."""


@dataclass(frozen=True)
class Table:
    """A table that a shader looks up.

    Attributes:
        sampler: Name of its uniform.
        values: float32; [rows, columns, channels], or [blue, green, red, 3] of three dimensions.
        is_linear: Whether it is filtered.
    """

    sampler: str
    values: np.ndarray
    is_linear: bool


@dataclass(frozen=True)
class ViewShader:
    """A view in GLSL.

    Attributes:
        text: Declarations and FUNCTION.
        tables: What it looks up.
    """

    text: str
    tables: tuple[Table, ...]


def configs() -> list[str]:
    """Return the names of the configs that there are."""
    return [*BUILT_IN, *([STUDIO] if os.environ.get("OCIO") else [])]


def displays(config: str) -> list[str]:
    """Return the names of a config's displays, its first choice first."""
    return list(_config(config, os.environ.get("OCIO", "")).getDisplays())


def views(config: str, display: str) -> list[str]:
    """Return the names of a display's views, its first choice first."""
    return list(_config(config, os.environ.get("OCIO", "")).getViews(display))


def completed(wanted: ColourView) -> ColourView:
    """Return a view with the first choice of a display or a view that the config does not have.

    Raises:
        InputError: There is no such config.
    """
    config = wanted.config if wanted.config in configs() else next(iter(BUILT_IN))
    shown = displays(config)
    display = wanted.display if wanted.display in shown else shown[0]
    found = views(config, display)
    return ColourView(config, display, wanted.view if wanted.view in found else found[0])


def chosen(text: str) -> tuple[ViewTransform, ColourView]:
    """Read the name of a view: sRGB, or CONFIG, CONFIG/DISPLAY or CONFIG/DISPLAY/VIEW.

    Raises:
        InputError: There is none of that name, or it cannot be had.
    """
    own = [view for view in ViewTransform if view is not ViewTransform.OPENCOLORIO]
    if text in own:
        return ViewTransform(text), ColourView()
    parts = text.split("/", 2)
    config = parts[0]
    if config not in configs():
        if config == STUDIO:
            raise InputError(
                "--view $OCIO: the environment variable OCIO is not set; expected a config's file."
            )
        raise _unknown("view or config", config, [*own, *configs()])
    display = parts[1] if len(parts) > 1 else displays(config)[0]
    if display not in displays(config):
        raise _unknown(f"display of {config}", display, displays(config))
    view = parts[2] if len(parts) > 2 else views(config, display)[0]
    if view not in views(config, display):
        raise _unknown(f"view of {display}", view, views(config, display))
    found = ColourView(config, display, view)
    view_shader(found)
    return ViewTransform.OPENCOLORIO, found


def view_shader(view: ColourView) -> ViewShader:
    """Return the GLSL of a view.

    Raises:
        InputError: The package is missing, or the config cannot be read or has no such view.
    """
    return _view_shader(view, os.environ.get("OCIO", ""))


def shown(view: ColourView, radiance: np.ndarray) -> np.ndarray:
    """Return what a view shows, on the processor.  [..., 3] -> [..., 3]."""
    cpu = _processor(view, os.environ.get("OCIO", "")).getDefaultCPUProcessor()
    pixels = np.ascontiguousarray(radiance, np.float32).reshape(-1, 3).copy()
    cpu.applyRGB(pixels)
    return pixels.reshape(radiance.shape)


@functools.lru_cache(maxsize=16)
def _view_shader(view: ColourView, studio: str) -> ViewShader:
    description = PyOpenColorIO.GpuShaderDesc.CreateShaderDesc(
        language=PyOpenColorIO.GPU_LANGUAGE_GLSL_4_0, functionName=FUNCTION, resourcePrefix="ocio_"
    )
    description.setAllowTexture1D(False)  # moderngl has none of one dimension
    _processor(view, studio).getDefaultGPUProcessor().extractGpuShaderInfo(description)
    tables = []
    for texture in description.getTextures():
        channels = 1 if texture.channel == PyOpenColorIO.GpuShaderDesc.TEXTURE_RED_CHANNEL else 3
        values = np.array(texture.getValues(), np.float32)
        tables.append(
            Table(
                texture.samplerName,
                values.reshape(texture.height, texture.width, channels),
                texture.interpolation != PyOpenColorIO.INTERP_NEAREST,
            )
        )
    for texture in description.get3DTextures():
        side = texture.edgeLen
        values = np.array(texture.getValues(), np.float32).reshape(side, side, side, 3)
        is_linear = texture.interpolation != PyOpenColorIO.INTERP_NEAREST
        tables.append(Table(texture.samplerName, values, is_linear))
    return ViewShader(description.getShaderText(), tuple(tables))


def _processor(view: ColourView, studio: str):
    """Return the way from linear Rec.709 to a display."""
    config = _config(view.config, studio)
    try:
        return config.getProcessor(_transform(config, view))
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        raise InputError(
            f"view {view}: OpenColorIO cannot make it ({_line(error)}). Choose another view."
        ) from error


def _transform(config, view: ColourView):
    """Return how a config shows linear Rec.709: by its own colour space, or by the interchange."""
    if config.getColorSpace(_LINEAR_REC709) is not None:
        return PyOpenColorIO.DisplayViewTransform(_LINEAR_REC709, view.display, view.view)
    if not config.hasRole(PyOpenColorIO.ROLE_INTERCHANGE_SCENE):
        raise InputError(
            f"{view.config}: the config has neither a colour space {_LINEAR_REC709!r} nor the role "
            "aces_interchange; expected one of them. Add the role to the config."
        )
    built_in = PyOpenColorIO.Config.CreateFromFile(next(iter(BUILT_IN.values())))
    to_aces = built_in.getProcessor(_LINEAR_REC709, _INTERCHANGE).createGroupTransform()
    group = PyOpenColorIO.GroupTransform(list(to_aces))
    group.appendTransform(
        PyOpenColorIO.DisplayViewTransform(
            PyOpenColorIO.ROLE_INTERCHANGE_SCENE, view.display, view.view
        )
    )
    return group


@functools.lru_cache(maxsize=4)
def _config(name: str, studio: str):
    """Read a config; `studio` is where the studio's is."""
    source = BUILT_IN.get(name, studio)
    try:
        return PyOpenColorIO.Config.CreateFromFile(source)
    except (PyOpenColorIO.Exception, PyOpenColorIO.ExceptionMissingFile) as error:
        raise InputError(
            f"{source}: not a config of OpenColorIO ({_line(error)}). "
            "Set the environment variable OCIO to one, or unset it."
        ) from error


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()).rstrip(".")


def _unknown(kind: str, name: str, known: list[str]) -> InputError:
    return InputError(f"--view: no {kind} {name!r}; expected one of {', '.join(known)}.")
