# SPDX-License-Identifier: Apache-2.0
"""The stage's own contract, rule by rule, in every representation that it holds.

This covers what USD's validators leave open: time range and rate, defaults beside time samples,
finite and sensible values, light units, image paths. Run UsdValidation as well for the rest. A
finding names the prim or, with its variant, the attribute: `/AsgRig{representation=cards}Lobes/...`
"""

import sys
from collections.abc import Container, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Ar, Sdf, Usd, UsdGeom, UsdLux

from asglight.images.decoding.decode import read_header
from asglight.images.decoding.strips import read_pixels
from asglight.usd import schema
from asglight.usd.check.limits import number_findings
from asglight.usd.check.references import may_open
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space, space_of
from asglight.usd.stage import (
    child_of,
    find_rig,
    has_lobe_api,
    held_representations,
    image_file,
    numbers,
    open_stage,
    sampled_values,
    show,
    shown_representation,
)

TEXTURE_MEAN = 1e-3
"""Of the mean of a card's texture. The rounding of its half floats is 2e-4 and evens out."""


def lint_stage(path: str | Path, known: Container[Sdf.Path] = ()) -> list[str]:
    """Check a stage against the contract that asglight's own stages keep.

    Args:
        path: The stage.
        known: Attributes whose numbers were checked as they were authored.

    Returns:
        Findings, one line each: `<prim or attribute>: <what was found>; expected <what>`.

    Raises:
        InputError: There is no such file or USD cannot read it.
    """
    stage = open_stage(path)
    rig = find_rig(stage)
    findings = list(_stage_findings(stage, rig))
    if rig is None:
        return [*findings, f"/: no prim with {schema.LOBES}; expected /{schema.RIG}"]
    findings += _lobe_findings(rig)
    held = held_representations(rig)
    if not held:
        names = ", ".join(Representation)
        return [*findings, f"{rig.GetPath()}: shows no representation; expected one of {names}"]
    if shown_representation(rig) is None:
        selected = rig.GetVariantSet(schema.VARIANT_SET).GetVariantSelection()
        findings.append(f"{rig.GetPath()}: selects {selected!r}; expected one representation")
    stage.SetEditTarget(stage.GetSessionLayer())
    seen: set[Sdf.Path] = set()
    times: set[float] = set()
    for representation in held:
        show(rig, representation)
        findings += _representation_findings(rig, representation)
        for prim in Usd.PrimRange(rig):
            for attribute in prim.GetAuthoredAttributes():
                place = attribute.GetPropertyStack()[0].path
                if place not in seen:
                    seen.add(place)
                    times.update(_ends(attribute))
                    found = _attribute_findings(attribute, are_known=place in known)
                    findings += [f"{place}: {text}" for text in found]
    return findings + list(_range_findings(stage, times))


def _stage_findings(stage: Usd.Stage, rig: Usd.Prim | None) -> Iterator[str]:
    root = stage.GetRootLayer()
    wanted = rig.GetPath().GetPrefixes()[0].name if rig else schema.RIG
    if root.defaultPrim != wanted:
        yield f"/: defaultPrim is {root.defaultPrim!r}; expected {wanted}"
    up_axis = (space_of(rig) if rig else Space()).up_axis
    if not stage.HasAuthoredMetadata(schema.UP_AXIS) or UsdGeom.GetStageUpAxis(stage) != up_axis:
        found = stage.GetMetadata(schema.UP_AXIS)
        yield f"/: upAxis is {found!r}; expected an explicit {up_axis}, as the lobes have"
    if not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        yield "/: metersPerUnit is not authored; expected an explicit length"
    rates = root.timeCodesPerSecond, root.framesPerSecond
    authored = root.HasTimeCodesPerSecond() and root.HasFramesPerSecond()
    if not authored or rates[0] != rates[1] or not rates[0] > 0:
        yield f"/: timeCodesPerSecond and framesPerSecond are {rates}; expected one explicit rate"
    if not stage.HasAuthoredTimeCodeRange():
        yield "/: startTimeCode or endTimeCode is not authored; expected the frame range"


def _range_findings(stage: Usd.Stage, times: set[float]) -> Iterator[str]:
    if not times or not stage.HasAuthoredTimeCodeRange():
        return
    stated = (stage.GetStartTimeCode(), stage.GetEndTimeCode())
    found = (min(times), max(times))
    if stated != found:
        yield (
            f"/: time codes run from {stated[0]:g} to {stated[1]:g}, samples from "
            f"{found[0]:g} to {found[1]:g}; expected the same range"
        )


def _lobe_findings(rig: Usd.Prim) -> Iterator[str]:
    lobes = child_of(rig, schema.LOBES).GetChildren()
    if not lobes:
        yield f"{rig.GetPath()}/{schema.LOBES}: empty; expected lobes"
    for lobe in lobes:
        if not has_lobe_api(lobe):
            yield f"{lobe.GetPath()}: without {schema.LOBE_API}; expected it on every lobe"


def _representation_findings(rig: Usd.Prim, representation: Representation) -> Iterator[str]:
    """Check that each lobe, or the dome, is lit, and that no other kind of light is active."""
    expected = schema.LIGHT_TYPES[representation]
    fill = child_of(rig, schema.FILL) if representation is Representation.CARDS else Usd.Prim()
    filled = bool(fill) and fill.GetTypeName() == schema.LIGHT_TYPES[Representation.DOME]
    keys = child_of(rig, schema.KEYS) if representation is Representation.KEYS else Usd.Prim()
    for light in Usd.PrimRange(rig):
        if filled and light == fill:
            continue
        if keys and light.GetParent() == keys and light.GetTypeName() in schema.KEY_TYPES.values():
            continue
        if light.HasAPI(UsdLux.LightAPI) and light.GetTypeName() != expected:
            yield (
                f"{light.GetPath()}: is a {light.GetTypeName()} in {representation}; "
                f"expected only {expected}"
            )
    dome = representation in (Representation.DOME, Representation.KEYS)
    lit = [rig] if dome else [] if filled else child_of(rig, schema.LOBES).GetChildren()
    for prim in lit:
        if not any(light.HasAPI(UsdLux.LightAPI) for light in Usd.PrimRange(prim)):
            yield f"{prim.GetPath()}: no light in {representation}; expected a {expected}"


def _ends(attribute: Usd.Attribute) -> set[float]:
    """Return the times of the first and the last sample; none without samples."""
    far = sys.float_info.max
    ends = (attribute.GetBracketingTimeSamples(time) for time in (-far, far))
    return {time for pair in ends for time in pair}


def _attribute_findings(attribute: Usd.Attribute, *, are_known: bool) -> Iterator[str]:
    name = attribute.GetName()
    default = attribute.Get()
    source = attribute.GetResolveInfo(Usd.TimeCode.Default()).GetSource()
    if attribute.GetNumTimeSamples() and source != Usd.ResolveInfoSourceDefault:
        yield "time samples without a default; expected both"
    if name == schema.OP_ORDER:
        yield from _transform_findings(attribute)
    elif name == schema.EXPOSURE:
        yield f"is {default}; expected no exposure, intensity says it all"
    elif name == schema.NORMALIZE:
        wanted = attribute.GetPrim().GetTypeName() == schema.LIGHT_TYPES[Representation.DISTANT]
        if default is not wanted:
            yield f"is {default}; expected {wanted} on a {attribute.GetPrim().GetTypeName()}"
    elif name == schema.TEXTURE_FORMAT and default != "latlong":
        yield f"is {default!r}; expected 'latlong'"
    elif attribute.GetTypeName() == Sdf.ValueTypeNames.Asset:
        times = attribute.GetTimeSamples()
        yield from _asset_findings(attribute, times)
        is_key = attribute.GetPrim().GetParent().GetName() == schema.KEYS
        if attribute.GetPrim().GetTypeName() == schema.LIGHT_TYPES[Representation.CARDS]:
            if times and not is_key:
                yield "changes over time; expected one image for all frames"
            yield from texture_findings(attribute, Usd.TimeCode.Default())
    elif schema.VALUE_TYPES.get(name) == attribute.GetTypeName() and not are_known:
        yield from _number_findings(attribute)


def _transform_findings(attribute: Usd.Attribute) -> Iterator[str]:
    """Report ops that can scale: renderers disagree on the size of a scaled light."""
    for op in UsdGeom.Xformable(attribute.GetPrim()).GetOrderedXformOps():
        kind = op.GetOpType()
        if "scale" in op.GetOpName() or kind == UsdGeom.XformOp.TypeTransform:
            yield f"{op.GetOpName()}; expected translation and rotation only"


def _asset_findings(attribute: Usd.Attribute, times: list[float]) -> Iterator[str]:
    codes = [Usd.TimeCode.Default(), *map(Usd.TimeCode, times)]
    for code in codes:
        asset = attribute.Get(code)
        if asset is None:
            continue
        at = "" if code.IsDefault() else f" at frame {code.GetValue():g}"
        if Path(asset.path).is_absolute() or not asset.path.startswith("."):
            yield f"is {asset.path}{at}; expected a path relative to the stage"
        elif not _is_there(asset):
            yield f"is {asset.path}{at}, which is not there; expected an image"


def texture_findings(attribute: Usd.Attribute, code: Usd.TimeCode) -> Iterator[str]:
    """Report a texture with which a card has another flux than in a program that drops it."""
    asset = attribute.Get(code)
    stage = Path(attribute.GetStage().GetRootLayer().realPath)
    if asset is None or not _is_there(asset) or not may_open(stage, asset.resolvedPath):
        return
    with image_file(asset.resolvedPath) as path:
        mean = _mean_light(attribute.GetPrim(), code, read_pixels(read_header(path)))
    if abs(mean - 1) > TEXTURE_MEAN:
        yield f"is {asset.path} of mean {mean:.4g}; expected 1, the flux of a card without it"


def _mean_light(card: Usd.Prim, code: Usd.TimeCode, image: NDArray[np.float32]) -> float:
    """Return the mean of a card's texture; of a key's, by the solid angles of its texels.

    Of a wide card those differ; its texture leaves flux as it is from where it was made.
    """
    rows = image.mean(-1, dtype=np.float64)
    if card.GetParent().GetName() != schema.KEYS:
        return float(rows.mean())
    high, wide = rows.shape
    y, x = (
        (1 - 2 * (np.arange(count) + 0.5) / count) * card.GetAttribute(name).Get(code) / 2
        for count, name in ((high, schema.HEIGHT), (wide, schema.WIDTH))
    )
    to_lobe = np.array(UsdGeom.Xformable(card).GetLocalTransformation(code))
    origin = np.linalg.inv(to_lobe)[3, :3]  # seen from the card
    weight = ((x - origin[0]) ** 2 + (y - origin[1])[:, None] ** 2 + origin[2] ** 2) ** -1.5
    return float((rows * weight).sum() / weight.sum())


def _is_there(asset: Sdf.AssetPath) -> bool:
    # within a package USD resolves only what the package holds
    return (
        Ar.IsPackageRelativePath(asset.resolvedPath)
        or Path(asset.resolvedPath or "missing").is_file()
    )


def _number_findings(attribute: Usd.Attribute) -> Iterator[str]:
    kind = attribute.GetTypeName()
    if kind not in (
        Sdf.ValueTypeNames.Float,
        Sdf.ValueTypeNames.Float2,
        Sdf.ValueTypeNames.Color3f,
        Sdf.ValueTypeNames.Double3,
        Sdf.ValueTypeNames.Quatf,
    ):
        return
    present = sampled_values(attribute)
    yield from number_findings(attribute.GetName(), numbers(present, kind), present)
