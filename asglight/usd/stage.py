# SPDX-License-Identifier: Apache-2.0
"""A stage on disk: opened with one clear message where it cannot be, and its lobes found."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, Vt

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.usd import schema
from asglight.usd.faults import reason


def open_stage(path: str | Path) -> Usd.Stage:
    """Open a stage, payloads unloaded, as it is on disk now.

    Raises:
        InputError: There is no file, or USD cannot read it.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{shown(path)}: no such file; expected a USD stage.")
    try:
        stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
        # USD keeps a layer in memory while anyone in the process holds it; a rewritten file is
        # reread, but nobody's unsaved edits are dropped.
        for layer in stage.GetUsedLayers():
            if not (layer.anonymous or layer.dirty):
                layer.Reload()
    except Tf.ErrorException as error:
        raise InputError(
            f"{shown(path)}: not readable as USD ({reason(error)}); expected a USD stage. "
            "Is the file whole?"
        ) from error
    return stage


def find_rig(stage: Usd.Stage) -> Usd.Prim | None:
    """Return the prim that holds the lobes' scope: the default prim, or /AsgRig."""
    for prim in (stage.GetDefaultPrim(), stage.GetPrimAtPath(f"/{schema.RIG}")):
        scope = prim.GetChild(schema.LOBES) if prim else None
        if scope and scope.IsDefined():  # an override alone, as in a variant, defines nothing
            return prim
    return None


def representation_of(path: str | Path) -> str | None:
    """Return the variant that a stage opens with: the lights that a renderer sees.

    Raises:
        InputError: There is no file, or USD cannot read it.
    """
    stage = open_stage(path)  # kept: the rig dies with its stage
    rig = find_rig(stage)
    return rig.GetVariantSet(schema.VARIANT_SET).GetVariantSelection() or None if rig else None


def has_lobe_api(prim: Usd.Prim) -> bool:
    """Tell whether AsgLobeAPI is applied, also where USD does not know the schema."""
    applied = prim.GetMetadata("apiSchemas") or Sdf.TokenListOp()
    return schema.LOBE_API in applied.GetAppliedItems()


def lobe_prims(rig: Usd.Prim) -> list[Usd.Prim]:
    """Return the active lobes of a rig in their order."""
    return [prim for prim in rig.GetChild(schema.LOBES).GetChildren() if has_lobe_api(prim)]


def lobe_names_of(path: str | Path) -> list[str]:
    """Return the names of a stage's lobes, in the order in which `read_usd` gives them.

    Raises:
        InputError: There is no such stage.
    """
    stage = open_stage(path)  # kept: the rig dies with its stage
    rig = find_rig(stage)
    return [prim.GetName() for prim in lobe_prims(rig)] if rig else []


def numbers(values: Iterable[object], kind: Sdf.ValueTypeName) -> NDArray[np.float64]:
    """Convert USD values to rows of numbers; quaternions as (w, x, y, z).  [F, K]."""
    if kind == Sdf.ValueTypeNames.Quatf:
        imaginary_first = np.asarray(Vt.QuatfArray(list(values)), dtype=np.float64)
        return np.roll(imaginary_first, 1, axis=-1)
    vectors = {
        Sdf.ValueTypeNames.Float2: Vt.Vec2fArray,
        Sdf.ValueTypeNames.Color3f: Vt.Vec3fArray,
        Sdf.ValueTypeNames.Double3: Vt.Vec3dArray,
    }
    if kind in vectors:
        return np.asarray(vectors[kind](list(values)), dtype=np.float64)
    return np.asarray(list(values), dtype=np.float64)[:, None]
