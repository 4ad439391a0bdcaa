# SPDX-License-Identifier: Apache-2.0
"""A stage on disk: opened with one clear message where it cannot be, and its lobes found."""

import itertools
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Tf, Usd, UsdLux, Vt

from asglight.errors import InputError
from asglight.images.latlong_image import read_header
from asglight.images.message import shown
from asglight.usd import schema
from asglight.usd.check.references import UnreadableError, checked_layers
from asglight.usd.faults import reason


def open_stage(path: str | Path) -> Usd.Stage:
    """Open a stage, payloads unloaded, as it is on disk now.

    Raises:
        InputError: There is no file, USD cannot read it, or it refers to layers that are not to be
            opened unasked (references.py).
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{shown(path)}: no such file; expected a USD stage.")
    with readable(path):
        kept = checked_layers(path)
        stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
        del kept
        # USD keeps a layer in memory while anyone in the process holds it; a rewritten file is
        # reread, but nobody's unsaved edits are dropped.
        for layer in stage.GetUsedLayers():
            if not (layer.anonymous or layer.dirty):
                layer.Reload()
    return stage


@contextmanager
def readable(path: str | Path) -> Iterator[None]:
    """Raise what USD says of a file that is damaged within as one line that names it.

    Raises:
        InputError: USD cannot read what is asked of it, or a text in it is none.
    """
    try:
        yield
    except Tf.ErrorException as error:
        raise _unreadable(path, reason(error)) from error
    except (UnreadableError, DamagedValueError) as error:
        raise _unreadable(path, str(error)) from error
    except UnicodeDecodeError as error:
        raise _unreadable(path, "a text in it is not UTF-8") from error
    except OSError as error:
        raise _unreadable(path, error.strerror or "it vanished") from error


def _unreadable(path: str | Path, said: str) -> InputError:
    return InputError(
        f"{shown(path)}: not readable as USD ({said}); expected a USD stage. Is the file whole?"
    )


def find_rig(stage: Usd.Stage) -> Usd.Prim | None:
    """Return the prim that holds the lobes' scope.

    It is the default prim, /AsgRig, or else the first that asglight has marked as one.
    """
    marked = (prim for prim in stage.Traverse() if prim.GetCustomDataByKey(schema.CUSTOM_DATA))
    usual = (stage.GetDefaultPrim(), stage.GetPrimAtPath(f"/{schema.RIG}"))
    for prim in itertools.chain(usual, marked):
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
    with readable(path):
        rig = find_rig(stage)
        return rig.GetVariantSet(schema.VARIANT_SET).GetVariantSelection() or None if rig else None


def open_rig(path: str | Path) -> tuple[Usd.Stage, Usd.Prim]:
    """Open a stage and find its rig; keep the stage, for the rig dies with it.

    Raises:
        InputError: There is no such stage, or it holds no lobes.
    """
    stage = open_stage(path)
    with readable(path):
        rig = find_rig(stage)
        if rig is None or not lobe_prims(rig):
            raise InputError(f"{shown(path)}: {_other_lights(stage)}")
    return stage, rig


def _other_lights(stage: Usd.Stage) -> str:
    """Say what a stage without lobes holds instead, and what to do with it."""
    kinds = Counter(prim.GetTypeName() for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI))
    lights = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    found = f"holds {lights}, and no" if lights else "holds no"
    return (
        f"{found} {schema.LOBE_API} prim; expected the lobes of a stage that asglight wrote. "
        "Fit the environment's images: asglight fit INPUT -o STAGE."
    )


def rig_data(rig: Usd.Prim) -> dict[str, Any]:
    """Return the custom data of a rig; none where it is lost or something else."""
    data = rig.GetCustomDataByKey(schema.CUSTOM_DATA)
    return data if isinstance(data, dict) else {}


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


def image_height(resolved: str) -> int:
    """Return the rows of an image of the dome, also of one within a package.

    Args:
        resolved: Its path as USD resolves it.

    Raises:
        InputError: It cannot be read.
    """
    with image_file(resolved) as path:
        return read_header(path).height


@contextmanager
def image_file(resolved: str) -> Iterator[Path]:
    """Give the file of an image, of one within a package a copy that lasts as long.

    Args:
        resolved: Its path as USD resolves it.

    Raises:
        InputError: The package is damaged.
    """
    if not Ar.IsPackageRelativePath(resolved):
        yield Path(resolved)
        return
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        copy = Path(folder) / "image.exr"
        with readable(resolved):
            asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(resolved))
            copy.write_bytes(asset.GetBuffer() if asset else b"")
        yield copy


class DamagedValueError(Exception):
    """A value is of another type than its attribute declares, or is no number a light can have."""


def numbers(values: Iterable[object], kind: Sdf.ValueTypeName) -> NDArray[np.float64]:
    """Convert USD values to rows of numbers; quaternions as (w, x, y, z).  [F, K].

    Raises:
        DamagedValueError: A value is not of that type; `readable` makes it one line.
    """
    try:
        return _numbers(list(values), kind)
    except (TypeError, ValueError) as error:
        raise DamagedValueError(f"a value is not of type {kind}") from error


def _numbers(values: list[Any], kind: Sdf.ValueTypeName) -> NDArray[np.float64]:
    if kind == Sdf.ValueTypeNames.Quatf:
        imaginary_first = np.asarray(Vt.QuatfArray(values), dtype=np.float64)
        return np.roll(imaginary_first, 1, axis=-1)
    vectors = {
        Sdf.ValueTypeNames.Float2: Vt.Vec2fArray,
        Sdf.ValueTypeNames.Color3f: Vt.Vec3fArray,
        Sdf.ValueTypeNames.Double3: Vt.Vec3dArray,
    }
    if kind in vectors:
        return np.asarray(vectors[kind](values), dtype=np.float64)
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 1:
        raise ValueError(values)
    return rows[:, None]
