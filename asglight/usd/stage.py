# SPDX-License-Identifier: Apache-2.0
"""A stage: opened with one clear message where it cannot be, and its lobes found."""

import itertools
import math
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from asglight.errors import InputError
from asglight.images.latlong_image import read_header
from asglight.images.message import shown
from asglight.usd import schema
from asglight.usd.check.absence import why_without_lobes
from asglight.usd.check.references import UnreadableError, checked_layers
from asglight.usd.faults import reason
from asglight.usd.options import KeyLights
from asglight.usd.schema import Representation


def open_stage(path: str | Path | Usd.Stage) -> Usd.Stage:
    """Open a stage with its payloads, as it is on disk now; one that is open is taken as it is.

    Raises:
        InputError: There is no file, USD cannot read it, or it refers to layers that are not to be
            opened unasked (references.py).
    """
    if isinstance(path, Usd.Stage):
        return path
    path = Path(path)
    found = _not_a_file(path)
    if found:
        raise InputError(f"{shown(path)}: {found}; expected a USD stage.")
    with readable(path), _quiet():
        kept = checked_layers(path)
        stage = Usd.Stage.Open(str(path))
        del kept
        # USD keeps a layer in memory while anyone in the process holds it; a rewritten file is
        # reread, but nobody's unsaved edits are dropped.
        for layer in stage.GetUsedLayers():
            if not (layer.anonymous or layer.dirty):
                layer.Reload()
    return stage


def _not_a_file(path: Path) -> str:
    """Return what a path is that is no file to read; empty for a file."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "no such file"
    except (OSError, ValueError) as error:  # a name too long, a loop of links, a zero byte
        return f"is no file ({getattr(error, 'strerror', None) or 'no name a file can have'})"
    if stat.S_ISDIR(mode):
        return "is a folder"
    return "" if stat.S_ISREG(mode) else "is no file"


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what USD warns of while it composes from standard error; `open_rig` says what counts."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        delegate.TakeUncoalescedDiagnostics()


def name_of(path: str | Path | Usd.Stage) -> str:
    """Return what to call a stage in a message."""
    if isinstance(path, Usd.Stage):
        return shown(path.GetRootLayer().realPath or path.GetRootLayer().identifier)
    return shown(path)


@contextmanager
def readable(path: str | Path | Usd.Stage) -> Iterator[None]:
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
    except UnexpectedError as error:
        raise InputError(
            f"{name_of(path)}: {error.found}; expected {error.expected}. "
            "Was the stage written by asglight, and not edited since?"
        ) from error
    except UnicodeDecodeError as error:
        raise _unreadable(path, "a text in it is not UTF-8") from error
    except OSError as error:
        raise _unreadable(path, error.strerror or "it vanished") from error


def _unreadable(path: str | Path | Usd.Stage, said: str) -> InputError:
    return InputError(
        f"{name_of(path)}: not readable as USD ({said}); expected a USD stage. Is the file whole?"
    )


def prims_of(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yield every prim that a renderer meets, those within instances too."""
    yield from Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())


def prims_below(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yield a prim and all below it that a renderer meets, within instances too."""
    yield from Usd.PrimRange(prim, Usd.TraverseInstanceProxies())


def child_of(prim: Usd.Prim, name: str) -> Usd.Prim:
    """Return a child by name, also of an instance, whose `GetChild` finds none."""
    return prim.GetStage().GetPrimAtPath(prim.GetPath().AppendChild(name))


def find_rigs(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return the prims that hold a scope of lobes and that a renderer meets.

    Those are the default prim, /AsgRig and all that asglight has marked.
    """
    usual = (stage.GetDefaultPrim(), stage.GetPrimAtPath(f"/{schema.RIG}"))
    marked = (prim for prim in prims_of(stage) if prim.GetCustomDataByKey(schema.CUSTOM_DATA))
    found: dict[Sdf.Path, Usd.Prim] = {}
    for prim in itertools.chain(usual, marked):
        if prim and prim.IsActive() and prim.IsDefined() and not prim.IsAbstract():
            scope = child_of(prim, schema.LOBES)
            if scope and scope.IsDefined():  # an override alone, as in a variant, defines nothing
                found.setdefault(prim.GetPath(), prim)
    return list(found.values())


def find_rig(stage: Usd.Stage) -> Usd.Prim | None:
    """Return the first prim that holds a scope of lobes, or None."""
    return next(iter(find_rigs(stage)), None)


def held_representations(rig: Usd.Prim) -> tuple[Representation, ...]:
    """Return the representations that a rig holds, in order: its variants, or its only one."""
    names = rig.GetVariantSet(schema.VARIANT_SET).GetVariantNames()
    if names:
        return tuple(one for one in Representation if one in names)
    alone = shown_representation(rig)
    return (alone,) if alone else ()


def show(rig: Usd.Prim, representation: Representation) -> None:
    """Select a representation that a rig holds, at the edit target of its stage."""
    variants = rig.GetVariantSet(schema.VARIANT_SET)
    if variants.GetVariantNames() and variants.GetVariantSelection() != representation:
        variants.SetVariantSelection(str(representation))


def place_of(rig: Usd.Prim, representation: Representation) -> Sdf.Path:
    """Return where a rig's lights of a representation are said: in its variant, or in the rig."""
    path = rig.GetPath()
    if not rig.GetVariantSet(schema.VARIANT_SET).GetVariantNames():
        return path
    return path.AppendVariantSelection(schema.VARIANT_SET, str(representation))


def representations_of(
    path: str | Path | Usd.Stage, rig: str | None = None
) -> tuple[str | None, list[str]]:
    """Return the representation that a stage opens with, and all that it holds, in their order.

    Raises:
        InputError: As `open_rig`.
    """
    stage, prim = open_rig(path, rig)  # the stage is kept: the rig dies with it
    with readable(stage):
        first = shown_representation(prim)
        return str(first) if first else None, [str(one) for one in held_representations(prim)]


def shown_representation(rig: Usd.Prim) -> Representation | None:
    """Return which representation a rig shows; None where it shows none.

    That is the selected variant; of a rig without variants the only one that was written or, as
    after flattening, what its lights are.
    """
    variants = rig.GetVariantSet(schema.VARIANT_SET)
    if variants.GetVariantNames():
        selected = variants.GetVariantSelection()
        return Representation(selected) if selected in set(Representation) else None
    written = rig_data(rig).get(schema.REPRESENTATION)
    if written in set(Representation):
        return Representation(written)
    if child_of(rig, schema.REST):
        return Representation.KEYS
    if child_of(rig, schema.DOME):
        return Representation.DOME
    kinds = {str(prim.GetTypeName()) for prim in prims_below(rig)}
    if child_of(rig, schema.FILL) or schema.LIGHT_TYPES[Representation.CARDS] in kinds:
        return Representation.CARDS
    has_distant = schema.LIGHT_TYPES[Representation.DISTANT] in kinds
    return Representation.DISTANT if has_distant else None


def open_rig(path: str | Path | Usd.Stage, rig: str | None = None) -> tuple[Usd.Stage, Usd.Prim]:
    """Open a stage and find its rig; keep the stage, for the rig dies with it.

    Args:
        path: The stage.
        rig: Path of the prim that holds the lobes, of a stage with several; None for the only one.

    Raises:
        InputError: There is no such stage, it holds no lobes, or several rigs and none is named.
    """
    stage = open_stage(path)
    with readable(path):
        rigs = [prim for prim in find_rigs(stage) if lobe_prims(prim)]
        listed = ", ".join(str(prim.GetPath()) for prim in rigs)
        if not rigs:
            raise InputError(f"{name_of(path)}: {why_without_lobes(stage)}")
        if rig is not None:
            rigs = [prim for prim in rigs if str(prim.GetPath()) == rig]
        if not rigs:
            raise InputError(f"{name_of(path)}: {shown(rig or '')} holds no lobes; {listed} does.")
        if len(rigs) > 1:
            raise InputError(
                f"{name_of(path)}: holds {len(rigs)} rigs ({listed}), whose light adds up; "
                f"expected one. Name the one to read: --rig {rigs[0].GetPath()}."
            )
    return stage, rigs[0]


def rig_data(rig: Usd.Prim) -> dict[str, Any]:
    """Return the custom data of a rig; none where it is lost or something else."""
    data = rig.GetCustomDataByKey(schema.CUSTOM_DATA)
    return data if isinstance(data, dict) else {}


def has_lobe_api(prim: Usd.Prim) -> bool:
    """Tell whether AsgLobeAPI is applied, also where USD does not know the schema."""
    applied = prim.GetMetadata("apiSchemas") or Sdf.TokenListOp()
    return schema.LOBE_API in applied.GetAppliedItems()


def lobe_prims(rig: Usd.Prim, scope: str = schema.LOBES) -> list[Usd.Prim]:
    """Return the active lobes of a rig in their order, or its keys."""
    holder = child_of(rig, scope)
    return [prim for prim in holder.GetChildren() if has_lobe_api(prim)] if holder else []


def key_lights(keys: Iterable[Usd.Prim]) -> KeyLights:
    """Return what the keys of a rig shine as; without any, as rectangles."""
    distant = schema.KEY_TYPES[KeyLights.DISTANT]
    is_distant = any(prim.GetTypeName() == distant for prim in keys)
    return KeyLights.DISTANT if is_distant else KeyLights.RECT


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


class UnexpectedError(Exception):
    """What a stage says of itself is nothing that it can be read with.

    Attributes:
        found: What it says.
        expected: What it should say.
    """

    def __init__(self, found: str, expected: str) -> None:
        """Take both halves of the message."""
        super().__init__(found)
        self.found, self.expected = found, expected


def meters_per_unit(stage: Usd.Stage) -> float:
    """Return the length of a unit.

    Raises:
        UnexpectedError: It is no length.
    """
    length = UsdGeom.GetStageMetersPerUnit(stage)
    if not (math.isfinite(length) and length > 0):
        raise UnexpectedError(f"metersPerUnit {length:g}", "a length above 0")
    return length


class DamagedValueError(Exception):
    """A value is of another type than its attribute declares, or is no number a light can have."""


def sampled_values(attribute: Usd.Attribute) -> list[Any]:
    """Return the default of an attribute and its time samples, without times; blocks are left out.

    They are read from the layer that holds them, all at once: a fifth of the time of one by one.
    """
    at_samples = attribute.GetResolveInfo(Usd.TimeCode.EarliestTime()).GetSource()
    found = [attribute.Get()]
    if at_samples == Usd.ResolveInfoSourceTimeSamples:
        stack = attribute.GetPropertyStack()
        sampled = (spec.GetInfo("timeSamples") for spec in stack if spec.HasInfo("timeSamples"))
        found += next(sampled).values()
    elif at_samples == Usd.ResolveInfoSourceValueClips:
        found += map(attribute.Get, attribute.GetTimeSamples())
    return [value for value in found if not (value is None or isinstance(value, Sdf.ValueBlock))]


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
        Sdf.ValueTypeNames.Float3: Vt.Vec3fArray,
        Sdf.ValueTypeNames.Color3f: Vt.Vec3fArray,
        Sdf.ValueTypeNames.Double3: Vt.Vec3dArray,
    }
    if kind in vectors:
        return np.asarray(vectors[kind](values), dtype=np.float64)
    rows = np.asarray(values, dtype=np.float64)
    if rows.ndim != 1:
        raise ValueError(values)
    return rows[:, None]
