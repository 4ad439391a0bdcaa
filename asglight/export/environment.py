# SPDX-License-Identifier: Apache-2.0
"""The lobes of one frame as a GLSL include: the environment, a matte and a glossy surface under it.

The functions are those of shaders/, with the lobes as constants; the text serves GLSL 3.30 core and
GLSL ES 3.00. docs/export.md says how to use it.

Symbols: N lobes, M sheets (asglight.shading.sheets).
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from asglight import __version__
from asglight.export import albedo, glsl_text
from asglight.images.output import written_beside
from asglight.lobes import Lobes, LobeTracks
from asglight.shader_files import enum_number, included_lines
from asglight.shading import ggx_lobes
from asglight.shading.ggx_lobes_constants import KERNEL, SHARE
from asglight.shading.glsl_constants import CONSTANTS
from asglight.shading.sheets import Sheets, amplitudes, sheets

ENTRIES = ("asg_environment", "asg_irradiance_over_pi", "asg_albedo", "asg_shade")
"""What the include is for; all else in it is there for these."""

_LIBRARY = ("lib/asg.glsl", "lib/ggx_lobes_free.glsl")

_HEADER = """\
// SPDX-License-Identifier: Apache-2.0
// An HDR environment as {count} lobes of form {form}, frame {frame}. Made by asglight {version}.
//
//   vec3 asg_environment(vec3 direction)         linear radiance from a unit direction
//   vec3 asg_irradiance_over_pi(vec3 normal)     what a white matte surface shows
//   vec3 asg_shade(vec3 normal, vec3 view, float roughness, vec3 f0)
//                                                what a GGX layer shows; alpha = roughness^2
//   vec3 asg_albedo(float cos_view, float roughness, vec3 f0)
//                                                what that layer reflects in a white furnace,
//                                                within {albedo_error:g}
//
// Right-handed, +Y up, linear Rec.709. GLSL 3.30 core, GLSL ES 3.00; include it after #version.

#ifdef GL_ES
precision highp float;
precision highp int;
#endif
"""


def write_glsl(path: str | Path, tracks: LobeTracks, frame: int) -> None:
    """Write the lobes of one frame as a GLSL include.

    Args:
        path: The target; its folder must exist.
        tracks: Lobes of all frames.
        frame: One of `tracks.frames`.

    Raises:
        InputError: The file cannot be written there.
        KeyError: There is no such frame.
    """
    text = environment(tracks.at(frame), frame)
    with written_beside(Path(path)) as place:
        place.write_text(text, encoding="utf-8")


def environment(lobes: Lobes, frame: int) -> str:
    """Return the include.

    Args:
        lobes: N lobes; those without light are left out.  [N, .]
        frame: Named in the first line.
    """
    lit = _lit(lobes.to("cpu", torch.float64))
    made = sheets(lit)
    is_round = bool((made.disc_variance[:, 0] == made.disc_variance[:, 1]).all())
    defined = {"ISOTROPIC"} if is_round else set()
    library = glsl_text.blocks(glsl_text.resolved(_lines(_LIBRARY), defined))
    entries = glsl_text.blocks(_lines(["export/environment.glsl"]))
    constants = [
        glsl_text.Block(name, _scalar(name, value))
        for name, value in {**CONSTANTS, **_scene_constants(lit, made)}.items()
    ]
    data = [glsl_text.Block(name, _array(name, rows)) for name, rows in _arrays(lit, made).items()]
    chosen = glsl_text.reached([*constants, *library, *data, *entries], ENTRIES)
    header = _HEADER.format(
        count=lit.count,
        form=lit.form,
        frame=frame,
        version=__version__,
        albedo_error=albedo.ERROR_MAX,
    )
    text = "\n".join([header, *(f"{block.text}\n" for block in chosen)])
    # Constants of one line need no blank line between them.
    text = glsl_text.renamed(text, glsl_text.prefixed(block.name for block in chosen))
    return text.replace(";\n\nconst ", ";\nconst ")


def _lit(lobes: Lobes) -> Lobes:
    """Leave out lobes without light; the last stays, for GLSL has no empty array."""
    lit = (lobes.amplitude > 0).any(-1)
    lit[-1] |= not bool(lit.any())
    return lobes.select(lit)


def _lines(files: Iterable[str]) -> list[str]:
    return [line.text for name in files for line in included_lines(name)]


def _scene_constants(lobes: Lobes, made: Sheets) -> Mapping[str, float]:
    return {
        "ASG_LOBES": lobes.count,
        "ASG_SHEETS": len(made.integral),
        "ASG_FORM": enum_number(lobes.form),
        "ASG_WINDOW": enum_number(made.window),
        # Of a sheet of sharpness 1, which the form decides.
        "ASG_DISC_VARIANCE": float(made.disc_variance[0, 0] * lobes.sharpness[0, 0]),
        "ASG_DISC": ggx_lobes.DISC_SCALES[made.window],
        "ASG_SHARE_MOVE": ggx_lobes.SHARE_MOVES[made.window],
        "ASG_DEGREES": len(KERNEL),
        "ASG_ALBEDO_TERMS": albedo.TERMS,
        "ASG_ALBEDO_COS_VIEW_MIN": albedo.COS_VIEW_MIN,
    }


def _arrays(lobes: Lobes, made: Sheets) -> Mapping[str, Tensor]:
    """Return the constants of several numbers.  [., 4] or [.]."""
    twins = len(made.integral) // lobes.count
    sharpness = lobes.sharpness.repeat(twins, 1)
    own = ggx_lobes.disc_mean(made.disc_variance, ggx_lobes.DISC_SCALES[made.window])
    white, grazing = (torch.from_numpy(rows.flatten()) for rows in albedo.polynomials())

    def rows(vectors: Tensor, fourth: Tensor) -> Tensor:
        return torch.cat([vectors, fourth[:, None]], dim=1)

    return {
        "ASG_AXIS_X": rows(made.axes[:, 0], sharpness[:, 0]),
        "ASG_AXIS_Y": rows(made.axes[:, 1], sharpness[:, 1]),
        "ASG_AXIS_Z": rows(made.axes[:, 2], made.mean),
        "ASG_VARIANCE": rows(made.variance, own.prod(-1).sqrt()),
        "ASG_AMPLITUDE": rows(amplitudes(lobes), made.integral / np.pi),
        "ASG_KERNEL": torch.tensor(KERNEL, dtype=torch.float64).flatten(0, 1),
        "ASG_SHARE": torch.tensor(SHARE, dtype=torch.float64),
        "ASG_ALBEDO_WHITE": white,
        "ASG_ALBEDO_GRAZING": grazing,
    }


_MEANINGS = {
    "ASG_AXIS_X": "xyz unit axis, w sharpness along it",
    "ASG_AXIS_Y": "xyz unit axis, w sharpness along it",
    "ASG_AXIS_Z": "xyz direction of the light, w mean of the cosine to it",
    "ASG_VARIANCE": "xyz variance along the axes, w mean of the Gaussian over its disc",
    "ASG_AMPLITUDE": "rgb linear radiance at ASG_AXIS_Z, w integral over pi",
}


def _scalar(name: str, value: float) -> str:
    kind, text = ("int", str(value)) if isinstance(value, int) else ("float", _number(value))
    return f"const {kind} {name} = {text};"


def _array(name: str, values: Tensor) -> str:
    """Return a constant array, one vector on a line."""
    if values.ndim == 1:
        kind, cells = "float", [_number(value) for value in values.tolist()]
    else:
        kind = f"vec{values.shape[1]}"
        cells = [f"{kind}({', '.join(map(_number, row))})" for row in values.tolist()]
    size = f"[{len(cells)}]"
    meaning = f"// {_MEANINGS[name]}\n" if name in _MEANINGS else ""
    listed = ",\n    ".join(cells)
    return f"{meaning}const {kind} {name}{size} = {kind}{size}(\n    {listed});"


def _number(value: float) -> str:
    """Return the shortest text that float32 reads as the value; it is a float in GLSL too."""
    return str(np.float32(value))
