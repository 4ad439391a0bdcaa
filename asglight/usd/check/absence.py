# SPDX-License-Identifier: Apache-2.0
"""Why a stage shows no lobes, and what to do about it: the first cause that holds."""

import os
from collections import Counter
from collections.abc import Iterator

from pxr import Ar, Sdf, Usd, UsdLux

from asglight.images.message import listing, shown
from asglight.usd import schema


def why_without_lobes(stage: Usd.Stage) -> str:
    """Say why no lobes of a stage are met, and the fix.

    A layer or a payload that is not there may hold anything, so it counts before prims that
    are there and not shown.
    """
    every = list(Usd.PrimRange.Stage(stage, Usd.PrimAllPrimsPredicate))
    missing = [*missing_layers(stage)]
    if missing:
        return (
            f"refers to {listing(missing)}, which {_is(missing)} not there; expected the "
            "layer that holds the lobes. Put it there or correct the path."
        )
    muted = stage.GetMutedLayers()
    if muted:
        return f"shows no lobes while {listing(muted)} is muted; expected them. Unmute the layer."
    unloaded = [prim.GetPath() for prim in every if prim.HasAuthoredPayloads()]
    unloaded = [path for path in unloaded if path not in stage.GetLoadSet()]
    if unloaded:
        return (
            f"has a payload at {listing(unloaded)} that is not loaded; expected lobes. Load it: "
            "stage.Load()."
        )
    inactive = [prim.GetPath() for prim in every if not prim.IsActive()]
    if inactive:
        return (
            f"has {listing(inactive)} deactivated and shows no lobes; expected an active rig. "
            "Activate it."
        )
    hidden = [prim for prim in every if prim.GetCustomDataByKey(schema.CUSTOM_DATA)]
    hidden = [prim for prim in hidden if prim.IsAbstract() or not prim.IsDefined()]
    if hidden:
        kind = "a class" if hidden[0].IsAbstract() else "an override alone"
        return (
            f"has lobes at {hidden[0].GetPath()}, which is {kind}, and USD shows none of it; "
            "expected a prim that is defined. Refer to it from one."
        )
    return _other_lights(every)


def missing_layers(stage: Usd.Stage) -> Iterator[str]:
    """Yield the layers that the layers of a stage name, and that are not there."""
    for layer in stage.GetUsedLayers():
        for said in layer.GetCompositionAssetDependencies():
            target = layer.ComputeAbsolutePath(said)
            file = Ar.SplitPackageRelativePathOuter(Sdf.Layer.SplitIdentifier(target)[0])[0]
            if not Sdf.Layer.IsAnonymousLayerIdentifier(said) and not os.path.exists(file):
                yield shown(said)


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _other_lights(every: list[Usd.Prim]) -> str:
    """Say what a stage without lobes holds instead, and what to do with it."""
    kinds = Counter(prim.GetTypeName() for prim in every if prim.HasAPI(UsdLux.LightAPI))
    lights = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    found = f"holds {lights}, and no" if lights else "holds no"
    return (
        f"{found} {schema.LOBE_API} prim; expected the lobes of a stage that asglight wrote. "
        "Fit the environment's images: asglight fit INPUT -o STAGE."
    )
