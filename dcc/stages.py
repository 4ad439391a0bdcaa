# SPDX-License-Identifier: Apache-2.0
"""The stages that are rendered: an exported one at one frame, or a dome of the original image.

Blender animates transforms only and reads everything else at time 0. A layer of one line over the
exported stage moves its time so that 0 is the frame asked for; the stage's files stay as they are.
"""

from pathlib import Path

from pxr import Sdf

from asglight.usd.schema import RIG, VARIANT_SET


def at_frame(stage: Path, frame: int, representation: str, target: Path) -> Path:
    """Write a layer that shows a frame of a stage at time 0 in one representation.

    Args:
        stage: The exported stage.
        frame: Time code that becomes 0.
        representation: The variant to show.
        target: The layer to write, .usda.

    Returns:
        The target.
    """
    source = Sdf.Layer.FindOrOpen(str(stage))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.subLayerPaths.append(str(stage.resolve()))
    layer.subLayerOffsets[0] = Sdf.LayerOffset(offset=-frame)
    for key in ("upAxis", "metersPerUnit"):  # USD reads these from the top layer only
        layer.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
    layer.defaultPrim = source.defaultPrim
    layer.timeCodesPerSecond = layer.framesPerSecond = source.timeCodesPerSecond
    layer.startTimeCode = layer.endTimeCode = 0
    rig = Sdf.CreatePrimInLayer(layer, f"/{RIG}")
    rig.variantSelections[VARIANT_SET] = representation
    layer.Export(str(target))
    return target


def original(image: Path, target: Path) -> Path:
    """Write a stage that holds nothing but a dome of an image, Y-up.  Returns the target."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.pseudoRoot.SetInfo("upAxis", "Y")
    layer.pseudoRoot.SetInfo("metersPerUnit", 1.0)
    layer.defaultPrim = "Dome"
    dome = Sdf.PrimSpec(layer, "Dome", Sdf.SpecifierDef, "DomeLight")
    values = {
        "inputs:intensity": (Sdf.ValueTypeNames.Float, 1.0),
        "inputs:texture:file": (Sdf.ValueTypeNames.Asset, Sdf.AssetPath(str(image.resolve()))),
        "inputs:texture:format": (Sdf.ValueTypeNames.Token, "latlong"),
    }
    for name, (kind, value) in values.items():
        Sdf.AttributeSpec(dome, name, kind).default = value
    layer.Export(str(target))
    return target
