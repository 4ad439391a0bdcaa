# SPDX-License-Identifier: Apache-2.0
"""The words of the stage: prim paths, attribute names and their types.

    /AsgRig                 Xform; custom data `asglight`; with several representations the variant
                            set `representation`; or any other path, below Xforms
    /AsgRig/Lobes/lobe_NN   the lobe: AsgLobeAPI and xformOp:orient, outside the variants
        cards               RectLight at (0, 0, distance) of the lobe frame if it is sharp, an
                            Xform with three of them if it is softer, a mere Xform if it is broad;
                            a RectLight with a texture where one was asked for
        distant             DistantLight, or an Xform with three of them
        dome, keys          Xform: data only
    /AsgRig/Fill            DomeLight of the broad lobes, in cards only
    /AsgRig/Dome            DomeLight of all lobes, in dome only
    /AsgRig/Keys/key_NN     a lamp, in keys only: RectLight or DistantLight, and that as a lobe; a
                            RectLight that does not face the origin has its middle and its turn in
                            the lobe frame, and as a lobe its slant
    /AsgRig/Rest            DomeLight of the images without these lamps, in keys only

A stage of one representation has no variants: its lights are said where the lobes are, and the
custom data names it.

A light shines along its local -Z. A lobe of the bingham form shines from two sides: in `cards` and
`distant` its prim is an Xform that holds lights for both, `front` (axis_z) and `back` (-axis_z).
"""

from pathlib import Path

from pxr import Sdf

from asglight.usd.options import KeyLights, Representation

SCHEMA_FOLDER = Path(__file__).resolve().parent / "resources"
"""The codeless schema; USD finds it when PXR_PLUGINPATH_NAME names this folder."""

FORMAT_VERSION = 1
"""Version of the stage layout, stored with the stage."""

LOBE_API, COLORSPACE_API = "AsgLobeAPI", "ColorSpaceAPI"
RIG, LOBES, DOME, FILL = "AsgRig", "Lobes", "Dome", "Fill"
KEYS, REST = "Keys", "Rest"
DISPLAY_NAME, VISIBILITY = "displayName", "visibility"
"""What a person calls a prim, and whether it is seen: USD's own, which other programs show."""
SIDES = ("front", "back")
VARIANT_SET = "representation"

CUSTOM_DATA = "asglight"
"""Key of the custom data on the rig: {int version, string upAxis, double distance,
int distantLights, bool cardTexture, string representation, string metadata (JSON), int[] frames};
the representation only where the rig has one alone."""
REPRESENTATION = "representation"
UP_AXIS, DISTANCE = "upAxis", "distance"
DISTANT_LIGHTS, CARD_TEXTURE = "distantLights", "cardTexture"
"""Keys there; `UP_AXIS` is also that of the stage's own axis."""
DIGEST = "digest"
"""Key of the custom data on a lobe: {string digest} (asglight.usd.digest)."""

ORIENT = "xformOp:orient"
TRANSLATE = "xformOp:translate:dist"
ORIENT_BACK, ORIENT_SIDE = "xformOp:orient:back", "xformOp:orient:side"
ORIENT_SLANT = "xformOp:orient:slant"
"""How a key that does not face the origin is turned from its lobe's frame."""
ROTATE_DOME = "xformOp:rotateX:orientToStageUpAxis"
OP_ORDER = "xformOpOrder"
SHARPNESS, AMPLITUDE, FORM = "asg:sharpness", "asg:amplitude", "asg:form"
LOBE_TRACKS = (ORIENT, SHARPNESS, AMPLITUDE)
"""What a lobe is, besides its form."""
MIDDLE, TURN, GROWTH = "asg:card:middle", "asg:card:turn", "asg:card:growth"
SLANT_TRACKS = (MIDDLE, TURN, GROWTH)
"""The slant of a key's card (asglight.lobes.rectangles); of one that faces the origin not said."""
WIDTH, HEIGHT, ANGLE = "inputs:width", "inputs:height", "inputs:angle"
INTENSITY, COLOR, NORMALIZE = "inputs:intensity", "inputs:color", "inputs:normalize"
TEXTURE, TEXTURE_FORMAT = "inputs:texture:file", "inputs:texture:format"
EXPOSURE = "inputs:exposure"
COLORSPACE = "colorSpace:name"

VALUE_TYPES = {
    ORIENT: Sdf.ValueTypeNames.Quatf,
    ORIENT_BACK: Sdf.ValueTypeNames.Quatf,
    ORIENT_SIDE: Sdf.ValueTypeNames.Quatf,
    ORIENT_SLANT: Sdf.ValueTypeNames.Quatf,
    MIDDLE: Sdf.ValueTypeNames.Float2,
    TURN: Sdf.ValueTypeNames.Float3,
    GROWTH: Sdf.ValueTypeNames.Float2,
    TRANSLATE: Sdf.ValueTypeNames.Double3,
    ROTATE_DOME: Sdf.ValueTypeNames.Float,
    OP_ORDER: Sdf.ValueTypeNames.TokenArray,
    SHARPNESS: Sdf.ValueTypeNames.Float2,
    AMPLITUDE: Sdf.ValueTypeNames.Color3f,
    FORM: Sdf.ValueTypeNames.Token,
    COLORSPACE: Sdf.ValueTypeNames.Token,
    WIDTH: Sdf.ValueTypeNames.Float,
    HEIGHT: Sdf.ValueTypeNames.Float,
    ANGLE: Sdf.ValueTypeNames.Float,
    INTENSITY: Sdf.ValueTypeNames.Float,
    COLOR: Sdf.ValueTypeNames.Color3f,
    NORMALIZE: Sdf.ValueTypeNames.Bool,
    TEXTURE: Sdf.ValueTypeNames.Asset,
    TEXTURE_FORMAT: Sdf.ValueTypeNames.Token,
}

UNIFORM = frozenset({OP_ORDER, FORM, COLORSPACE})
"""Attributes that cannot change over time; UsdLux inputs are all varying."""


LIGHT_TYPES = {
    Representation.CARDS: "RectLight",
    Representation.DISTANT: "DistantLight",
    Representation.DOME: "DomeLight",
    Representation.KEYS: "DomeLight",
}
"""Of the lights of lobes; in `keys`, whose lobes are data, that of the rest."""

KEY_TYPES = {KeyLights.RECT: "RectLight", KeyLights.DISTANT: "DistantLight"}
