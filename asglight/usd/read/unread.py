# SPDX-License-Identifier: Apache-2.0
"""What a stage says of its lights that lobes cannot hold: one line for each kind, never silence."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdGeom, UsdLux

from asglight.images.message import listing, shown
from asglight.usd import schema
from asglight.usd.read.placement import Placement
from asglight.usd.schema import Representation
from asglight.usd.stage import child_of, prims_below, prims_of

CONE_FREE = 90.0
"""Degrees from its axis in which a cone leaves a light as it is: those that face it."""

DOME_FOLDER = "_dome"
"""How a folder of images that asglight writes ends."""

LISTED = 3
"""Prims that a line names before it counts the others."""


def unread_of(rig: Usd.Prim, placement: Placement) -> list[str]:
    """Return what the lights of a rig do that its lobes do not, `<prims>: <what>` a line.

    Args:
        rig: The prim that holds the lobes.
        placement: How it stands in the stage.
    """
    found: dict[str, list[str]] = {}
    for text, prim in _of_rig(rig, placement):
        found.setdefault(text, []).append(str(prim.GetPath()))
    return [f"{_some(paths)}: {text}" for text, paths in found.items()] + _beside(rig)


def _some(paths: list[str]) -> str:
    more = len(paths) - LISTED
    return listing(paths[:LISTED]) + (f" and {more} more" if more > 0 else "")


def _of_rig(rig: Usd.Prim, placement: Placement) -> Iterator[tuple[str, Usd.Prim]]:
    variants = rig.GetVariantSet(schema.VARIANT_SET)
    names, selected = variants.GetVariantNames(), variants.GetVariantSelection()
    if names and selected not in names:
        name = shown(selected) or "none"
        yield f"selects the representation {name}, which has no lights; read as its lobes say", rig
    purpose = UsdGeom.Imageable(rig).ComputePurpose()
    if purpose not in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render):
        yield f"has the purpose {purpose}, which renderers leave out", rig
    if placement.is_stretched:
        yield (
            "is scaled unevenly: what has no cards is read as it is turned, and not stretched",
            rig,
        )
    for path in rig.GetPath().GetPrefixes()[:-1]:
        if rig.GetStage().GetPrimAtPath(path).IsA(UsdGeom.PointInstancer):
            yield "stands in a PointInstancer: read once, where it is written", rig
    for prim in prims_below(rig):
        if prim.HasAPI(UsdLux.LightAPI):
            yield from ((text, prim) for text in _of_light(prim))
    yield from _off_in_an_image(rig)


def _of_light(prim: Usd.Prim) -> Iterator[str]:
    light = UsdLux.LightAPI(prim)
    if _is_linked(light.GetLightLinkCollectionAPI()):
        yield "lights some prims only (light linking); read as if it lit all"
    if _is_linked(light.GetShadowLinkCollectionAPI()):
        yield "gets shadows from some prims only (shadow linking)"
    filters = light.GetFiltersRel().GetTargets()
    if filters:
        yield f"has light filters ({listing(filters)}), which are not read"
    portals = prim.GetRelationship("portals")
    if portals and portals.GetTargets():
        yield f"shines through portals only ({listing(portals.GetTargets())}); read as if open"
    diffuse, specular = light.GetDiffuseAttr(), light.GetSpecularAttr()
    if _varied(diffuse) != _varied(specular):
        yield (
            f"has multipliers of {diffuse.Get():g} on diffuse and {specular.Get():g} on specular "
            "reflection; a lobe lights both alike, and is read without them"
        )
    yield from _shaping(prim)
    yield from _image(prim)


def _varied(attribute: Usd.Attribute) -> tuple[Any, ...]:
    return (attribute.Get(), *(attribute.Get(time) for time in attribute.GetTimeSamples()))


def _is_linked(collection: Usd.CollectionAPI) -> bool:
    """Tell whether a collection leaves anything out."""
    if collection.GetMembershipExpressionAttr().HasAuthoredValue():
        return not collection.IsInRelationshipsMode() or _leaves_out(collection)
    return _leaves_out(collection)


def _leaves_out(collection: Usd.CollectionAPI) -> bool:
    return not collection.GetIncludeRootAttr().Get() or bool(
        collection.GetExcludesRel().GetTargets()
    )


def _shaping(prim: Usd.Prim) -> Iterator[str]:
    shaping = UsdLux.ShapingAPI(prim)
    cone, focus = shaping.GetShapingConeAngleAttr(), shaping.GetShapingFocusAttr()
    ies = shaping.GetShapingIesFileAttr()
    shaped = [
        (cone and any(float(value) < CONE_FREE for value in _varied(cone) if value is not None)),
        (focus and any(_varied(focus))),
        (ies and ies.Get() is not None and bool(ies.Get().path)),
    ]
    if any(shaped):
        yield "is shaped by a cone, focus or IES profile; read as it shines without"


def _image(prim: Usd.Prim) -> Iterator[str]:
    attribute = prim.GetAttribute(schema.TEXTURE)
    assets = _varied(attribute) if attribute else ()
    for asset in assets:
        if not isinstance(asset, Sdf.AssetPath) or not asset.path:
            continue
        if not asset.resolvedPath:
            yield f"has the image {shown(asset.path)}, which is not there; read as its lobes say"
            return
        if not Path(asset.path).parent.name.endswith(DOME_FOLDER):
            yield f"has an image of another origin ({shown(asset.path)}); read as its lobes say"
            return
    is_dome = prim.GetTypeName() == schema.LIGHT_TYPES[Representation.DOME]
    if is_dome and any(_varied(UsdLux.LightAPI(prim).GetNormalizeAttr())):
        yield "is a normalised dome, which programs show differently; read as if it were not"


def _off_in_an_image(rig: Usd.Prim) -> Iterator[tuple[str, Usd.Prim]]:
    """Name the lobes that are switched off, and whose light an image shows nevertheless."""
    dome = child_of(rig, schema.DOME) or child_of(rig, schema.FILL)
    if not dome or not dome.IsActive():
        return
    for prim in child_of(rig, schema.LOBES).GetAllChildren():
        lights = prims_below(prim) if prim.IsActive() else iter(())
        if any(one.HasAPI(UsdLux.LightAPI) for one in lights):
            continue
        has_own = prim.GetTypeName() != "Xform" or bool(prim.GetAllChildrenNames())
        if prim.IsActive() and not _is_hidden_below(prim, rig):
            continue
        if not has_own:
            name = dome.GetName()
            yield f"is off, and its light is in the image of {name}; read without it", prim


def _is_hidden_below(prim: Usd.Prim, rig: Usd.Prim) -> bool:
    """Tell whether a prim is invisible in a rig that is not."""
    hidden = UsdGeom.Tokens.invisible
    own = UsdGeom.Imageable(prim).ComputeVisibility()
    return own == hidden != UsdGeom.Imageable(rig).ComputeVisibility()


def _beside(rig: Usd.Prim) -> list[str]:
    """Name the lights that are no part of the rig."""
    kinds: dict[str, int] = {}
    for prim in prims_of(rig.GetStage()):
        is_light = prim.HasAPI(UsdLux.LightAPI) and not prim.GetPath().HasPrefix(rig.GetPath())
        if is_light and UsdGeom.Imageable(prim).ComputeVisibility() != UsdGeom.Tokens.invisible:
            kind = str(prim.GetTypeName())
            kinds[kind] = kinds.get(kind, 0) + 1
    if not kinds:
        return []
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    return [f"{rig.GetPath()}: lights beside it are not read ({counts})"]
