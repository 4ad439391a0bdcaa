# SPDX-License-Identifier: Apache-2.0
"""Lobes as a GLSL include that lights surfaces alone: no textures, no code of the host.

The functions are those of shaders/, taken apart and put together for the scene. The lobes of one
frame are constants of the text. Those of several are a uniform block, and a file of raw float32
holds the block of each frame. docs/reference/export.md says how to use both.

Symbols: F frames, N lobes, M sheets (asglight.shading.sheets).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from fileseq import framesToFrameRange
from numpy.typing import NDArray
from torch import Tensor

from asglight import __version__
from asglight.export import albedo, glsl_text
from asglight.export.keyed import TERMS
from asglight.images.message import shown
from asglight.images.output import written_beside
from asglight.lobes import Form, Lobes, LobeTracks, flat
from asglight.shader_files import enum_number, included_lines
from asglight.shading import ggx_lobes
from asglight.shading.ggx_layer import window_shares
from asglight.shading.ggx_lobes_constants import KERNEL
from asglight.shading.glsl_constants import CONSTANTS
from asglight.shading.sheets import Sheets, Window, amplitudes, sheets

ENTRIES = tuple(
    f"asglight_{name}" for name in ("evaluate", "irradiance", "albedo", "reflection", "shade")
)
"""What the include is for; all else in it is there for these."""

KEYED_ENTRIES = tuple(
    f"asglight_{name}"
    for name in (
        "evaluate",
        "irradiance",
        "rest_irradiance",
        "keyed_irradiance",
        "albedo",
        "reflection",
        "keyed_shade",
    )
)
"""The same of keys and rest; what shades with keys alone would be too dark, so it is left out."""

REST = "asg_rest"

BLOCK = "AsglightFrame"
"""The uniform block of a shot that moves."""

BLOCKS_SUFFIX = ".f32"
"""Of the file that holds the blocks of all frames."""

VECTORS = {
    "asg_axis_x": "xyz unit axis, w sharpness along it",
    "asg_axis_y": "xyz unit axis, w sharpness along it",
    "asg_axis_z": "xyz direction of the light, w mean of the cosine to it",
    "asg_variance": "xyz variance along the axes, w mean of the Gaussian over its disc",
    "asg_light": "rgb linear radiance at asg_axis_z, w integral over pi",
}
"""The vectors of a sheet, in the order of the uniform block."""

_HEADER = """\
// SPDX-License-Identifier: Apache-2.0
// An HDR environment as {count} lobes of form {form}, {span}. Made by asglight {version}.
//
//   vec3 asglight_evaluate(vec3 direction)       linear radiance from a unit direction
//   vec3 asglight_irradiance(vec3 normal)        matte surfaces show albedo / pi times that
//   vec3 asglight_shade(vec3 normal, vec3 view, float roughness, vec3 f0, vec3 base)
//                                                what GGX over a matte base shows the camera
//   vec3 asglight_reflection(vec3 normal, vec3 view, float roughness, vec3 f0)
//                                                its GGX layer alone; alpha = roughness^2
//   vec3 asglight_albedo(float cos_view, float roughness, vec3 f0)
//                                                what the layer reflects in a white furnace
//
"""

_KEYED_HEADER = """\
// SPDX-License-Identifier: Apache-2.0
// An HDR environment as {keys} and a rest, {span}. Made by asglight {version}.
//
//   vec3 asglight_keyed_irradiance(vec3 normal)  of keys and rest; matte surfaces show
//                                                albedo / pi times that
//   vec3 asglight_keyed_shade(vec3 normal, vec3 view, float roughness, vec3 f0, vec3 base,
//                             vec3 rest)         what GGX over a matte base shows the camera; rest
//                                                is the rest in the mirrored direction, prefiltered
//   vec3 asglight_rest_irradiance(vec3 normal)   of the rest alone
//   vec3 asglight_irradiance(vec3 normal)        of the keys alone
//   vec3 asglight_reflection(vec3 normal, vec3 view, float roughness, vec3 f0)
//                                                of the keys alone, by GGX; alpha = roughness^2
//   vec3 asglight_evaluate(vec3 direction)       linear radiance of the keys alone
//   vec3 asglight_albedo(float cos_view, float roughness, vec3 f0)
//                                                what the layer reflects in a white furnace
//
"""

_CONVENTIONS = """\
// Vectors are unit, in the world of the stage: right-handed, +Y up. Colours are linear Rec.709.
// GLSL 3.30 core or GLSL ES 3.00: put it after #version. What begins with asg_, ASG_ or Asg is its
// own; docs/reference/export.md of asglight has the rest.
{block}
#ifdef GL_ES
precision highp float;
precision highp int;
#endif
"""

_BLOCK_HEADER = """\
//
// The lobes are in the uniform block {block}: {size} bytes, little-endian float32. {file} holds
// the block of each frame in turn.
"""


_SOURCES = ("lib/ggx_lobes_free.glsl", "export/environment.glsl", "export/rest.glsl")


class Environment(NamedTuple):
    """What `write_glsl` writes.

    Attributes:
        text: The include.
        blocks: The uniform block of each frame, five vectors a sheet, then nine of a rest; None
            where all frames are the same and the lobes are constants of the text.  [F, V, 4]
    """

    text: str
    blocks: NDArray[np.float32] | None


def write_glsl(path: str | Path, tracks: LobeTracks, rest: Tensor | None = None) -> list[Path]:
    """Write tracks as a GLSL include; where they move, also the blocks of their frames beside it.

    Args:
        path: The target; its folder must exist, and its suffix is not BLOCKS_SUFFIX.
        tracks: Lobes of all frames, or keys.
        rest: Irradiance beside keys, as of `keyed.irradiance_terms`.  [F, 9, 3]

    Returns:
        The files that were written, the include first.

    Raises:
        InputError: A file cannot be written there.
    """
    path = Path(path)
    beside = path.with_suffix(BLOCKS_SUFFIX)
    made = environment(tracks, beside.name, rest)
    with written_beside(path) as place:
        place.write_text(made.text, encoding="utf-8")
        if made.blocks is None:
            return [path]
        with written_beside(beside) as blocks_place:
            blocks_place.write_bytes(made.blocks.astype("<f4").tobytes())
    return [path, beside]


def environment(tracks: LobeTracks, blocks_name: str, rest: Tensor | None = None) -> Environment:
    """Return the include and the blocks.

    Args:
        tracks: N lobes in F frames; those without light in any frame are left out.
        blocks_name: Of the file of the blocks, for the head of the text.
        rest: As of `write_glsl`.
    """
    lit = _lit(tracks.lobes.to("cpu", torch.float64))
    count, form = lit.count, lit.form
    if form is Form.FLAT:  # the include knows their terms alone
        lit = flat.terms(lit)
    made = sheets(lit)
    blocks = np.stack([rows.float().numpy() for rows in _vectors(lit, made).values()], axis=1)
    sheet_count = blocks.shape[2]
    blocks = blocks.reshape(len(blocks), -1, 4)
    if rest is not None:
        padded = np.pad(rest.float().numpy(), ((0, 0), (0, 0), (0, 1)))
        blocks = np.concatenate([blocks, padded], axis=1)
    is_still = bool((blocks == blocks[:1]).all())
    named = _HEADER if rest is None else _KEYED_HEADER
    head = (named + _CONVENTIONS).format(
        count=count,
        keys="1 key" if count == 1 else f"{count} keys",
        form=form,
        span=_span(tracks),
        version=__version__,
        block=""
        if is_still
        else _BLOCK_HEADER.format(block=BLOCK, size=blocks[0].nbytes, file=shown(blocks_name)),
    )
    if is_still:
        data = _constant_vectors(blocks[0], sheet_count)
    else:
        data = _uniform_block(sheet_count, has_rest=rest is not None)
    text = f"{head}\n{data}\n{_functions(lit, made, has_rest=rest is not None)}"
    return Environment(text, None if is_still else blocks)


def _lit(lobes: Lobes) -> Lobes:
    """Leave out lobes without light; the last stays, for GLSL has no empty array."""
    lit = (lobes.amplitude > 0).any(-1).any(0)
    lit[-1] |= not bool(lit.any())
    return lobes.select(lit)


def _span(tracks: LobeTracks) -> str:
    if len(tracks.frames) == 1:
        return f"frame {tracks.frames[0]}"
    return f"frames {framesToFrameRange(tracks.frames)} at {tracks.fps:g} fps"


def _vectors(lobes: Lobes, made: Sheets) -> Mapping[str, Tensor]:
    """Return what `VECTORS` names.  [F, M, 4] each."""
    twins = made.integral.shape[1] // lobes.count
    sharpness = lobes.sharpness.repeat(1, twins, 1)
    own = ggx_lobes.disc_mean(made.disc_variance, ggx_lobes.DISC_SCALES[made.window])
    parts = {
        "asg_axis_x": (made.axes[..., 0, :], sharpness[..., 0]),
        "asg_axis_y": (made.axes[..., 1, :], sharpness[..., 1]),
        "asg_axis_z": (made.axes[..., 2, :], made.mean),
        "asg_variance": (made.variance, own.prod(-1).sqrt()),
        "asg_light": (amplitudes(lobes), made.integral / np.pi),
    }
    return {name: torch.cat([xyz, w[..., None]], dim=-1) for name, (xyz, w) in parts.items()}


_REST_NOTE = "rgb coefficients of the rest's irradiance"


def _constant_vectors(block: NDArray[np.float32], count: int) -> str:
    """Return the vectors as constants.

    Args:
        block: [V, 4]
        count: Of the sheets.
    """
    places = range(0, len(VECTORS) * count, count)
    arrays = [
        (*one, block[at : at + count]) for one, at in zip(VECTORS.items(), places, strict=True)
    ]
    if len(block) > len(VECTORS) * count:
        arrays.append((REST, _REST_NOTE, block[len(VECTORS) * count :]))
    return "".join(f"// {note}\n{_array(name, rows)}\n" for name, note, rows in arrays)


def _uniform_block(count: int, *, has_rest: bool) -> str:
    members = "".join(
        f"    vec4 {name}[{count}];{' ' * (14 - len(name))}// {note}\n"
        for name, note in VECTORS.items()
    )
    if has_rest:
        members += f"    vec4 {REST}[{TERMS}];{' ' * (14 - len(REST))}// {_REST_NOTE}\n"
    return f"layout(std140) uniform {BLOCK} {{\n{members}}};\n"


def _functions(lobes: Lobes, made: Sheets, *, has_rest: bool) -> str:
    """Return the functions with the constants that they need, under names of their own."""
    is_round = bool((made.disc_variance[..., 0] == made.disc_variance[..., 1]).all())
    defined = {str(lobes.form).upper(), *(["ISOTROPIC"] if is_round else [])}
    functions = [
        block
        for name in _SOURCES[: 3 if has_rest else 2]
        for block in glsl_text.blocks(
            glsl_text.resolved([line.text for line in included_lines(name)], defined)
        )
    ]
    scalars = {**CONSTANTS, **_scene_constants(lobes, made)}
    constants = [
        *(glsl_text.Block(name, _scalar(name, value)) for name, value in scalars.items()),
        *(glsl_text.Block(name, _array(name, rows)) for name, rows in _fitted(made.window).items()),
    ]
    entries = KEYED_ENTRIES if has_rest else ENTRIES
    chosen = glsl_text.reached([*constants, *functions], entries)
    text = "\n".join(f"{block.text}\n" for block in chosen)
    text = glsl_text.renamed(text, glsl_text.prefixed(block.name for block in chosen))
    # Constants of one line need no blank line between them.
    return text.replace(";\n\nconst ", ";\nconst ")


def _scene_constants(lobes: Lobes, made: Sheets) -> Mapping[str, float]:
    return {
        "ASG_LOBES": lobes.count,
        "ASG_SHEETS": made.integral.shape[1],
        "ASG_WINDOW": enum_number(made.window),
        # Of a sheet of sharpness 1, which the form decides.
        "ASG_DISC_VARIANCE": float(made.disc_variance[0, 0, 0] * lobes.sharpness[0, 0, 0]),
        "ASG_DISC": ggx_lobes.DISC_SCALES[made.window],
        "ASG_DEGREES": len(KERNEL),
        "ASG_ALBEDO_TERMS": albedo.TERMS,
        "ASG_ALBEDO_COS_VIEW_MIN": albedo.COS_VIEW_MIN,
    }


def _fitted(window: Window) -> Mapping[str, NDArray]:
    """Return the constants that were fitted, for a scene of one window.  [., 4] or [.]."""
    white, grazing = albedo.polynomials()
    share = window_shares(window)
    return {
        "ASG_KERNEL": np.array(KERNEL).reshape(-1, 4),
        "ASG_SHARE": share[:, :4],
        "ASG_GAIN": np.pad(share[:, 4:], ((0, 0), (0, 1))),
        "ASG_ALBEDO_WHITE": white.ravel(),
        "ASG_ALBEDO_GRAZING": grazing.ravel(),
    }


def _scalar(name: str, value: float) -> str:
    kind, text = ("int", str(value)) if isinstance(value, int) else ("float", _number(value))
    return f"const {kind} {name} = {text};"


def _array(name: str, values: NDArray) -> str:
    """Return a constant array: vectors one on a line, numbers seven."""
    if values.ndim == 1:
        kind, cells = "float", [_number(value) for value in values]
        lines = [", ".join(cells[i : i + 7]) for i in range(0, len(cells), 7)]
    else:
        kind = f"vec{values.shape[1]}"
        lines = [f"{kind}({', '.join(map(_number, row))})" for row in values]
    size = f"[{len(values)}]"
    listed = ",\n    ".join(lines)
    return f"const {kind} {name}{size} = {kind}{size}(\n    {listed});"


def _number(value: float) -> str:
    """Return the shortest text that float32 reads as the value; it is a float in GLSL too."""
    return str(np.float32(value))
