# SPDX-License-Identifier: Apache-2.0
"""What a layer says of other files, found without opening any of them."""

from collections.abc import Iterator
from dataclasses import dataclass

from pxr import Sdf


@dataclass(frozen=True)
class LayerFacts:
    """What a layer refers to.

    Attributes:
        layers: Those it is composed with, in every variant: as it names them and as absolute paths.
        clips: A prim with value clips, which name more layers; None where there is none.
    """

    layers: tuple[tuple[str, str], ...]
    clips: str | None


def facts_of(layer: Sdf.Layer) -> LayerFacts:
    """Return what a layer refers to by sublayers, references, payloads and value clips."""
    layers = tuple(
        (name, Sdf.Layer.SplitIdentifier(layer.ComputeAbsolutePath(name))[0])
        for name in layer.GetCompositionAssetDependencies()
    )
    clips = next((str(spec.path) for spec in _prims(layer) if spec.HasInfo("clips")), None)
    return LayerFacts(layers, clips)


def _prims(layer: Sdf.Layer) -> Iterator[Sdf.PrimSpec]:
    waiting = list(layer.rootPrims)
    while waiting:
        spec = waiting.pop()
        yield spec
        waiting += spec.nameChildren
        for variants in spec.variantSets:
            waiting += [variant.primSpec for variant in variants.variants]
