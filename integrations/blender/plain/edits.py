# SPDX-License-Identifier: GPL-3.0-or-later
"""What was changed in Blender as a layer over the stage; needs `pxr`, not `bpy`.

The layer sublayers the stage and overrides what differs from it: intensity, colour, width and
height or angle, transform and visibility of lights, and how the rig is turned. `asglight info`
names these edits, and the viewer and `asglight` read them.

Dimension letter: T times.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from . import colours, rigs
from .rigs import Lamp, Place, Rig
from .targets import refuse_what_is_used
from .tracks import Array, Track, reduced

EDITED = 1e-3
"""Relative. What Blender keeps in float32 and interpolates is off by 1e-5; edits that anybody sees
are larger."""

MOVED = 1e-3
"""Of a light's distance, and of the components of its quaternion: 0.1 degrees."""

STAGE_KEYS = (
    *("upAxis", "metersPerUnit", "timeCodesPerSecond", "framesPerSecond"),
    *("startTimeCode", "endTimeCode"),
)
"""Metadata that USD does not compose from sublayers; the default prim is one more."""

TURN = "xformOp:rotate{axis}:blender"
TRANSFORM = "xformOp:transform:blender"
ORDER, RESET = "xformOpOrder", "!resetXformStack!"


@dataclass(frozen=True)
class Seen:
    """A light as it is in Blender at all times.

    Attributes:
        path: Its prim.
        light: Radiance or irradiance, with its colour, in Blender's colours.  [T, 3]
        size: Width and height in the stage's units, or the angle in degrees; of a dome none.
        visible: Whether it shines.  [T]
        position: From the rig, in the stage's units; of a dome none.  [T, 3]
        rotation: Unit quaternions, w first, of one hemisphere.  [T, 4]
    """

    path: str
    light: Array
    size: Array | None
    visible: Array
    position: Array | None
    rotation: Array | None


@dataclass(frozen=True)
class View:
    """All that is seen of a rig.

    Attributes:
        representation: That the rig was imported as.
        times: Time codes.  [T]
        lights: Those that are there; one that is not was deleted.
        turn: Of the rig about the vertical, in degrees; whole turns do not count.  [T]
        space: Color Interop ID of Blender's colours.
    """

    representation: str
    times: Array
    lights: Sequence[Seen]
    turn: Array
    space: str


def write_edits(source: Path, target: Path, rig_path: str, view: View) -> list[str]:
    """Write what differs from the stage as a layer over it.

    Args:
        source: The stage.
        target: The layer, .usda, .usdc or .usd; it may be neither the stage nor a layer of it.
        rig_path: Prim of the rig.
        view: What is seen in Blender.

    Returns:
        What was edited, one line a prim; without any, nothing is written.

    Raises:
        OSError: The layer cannot be written.
        ValueError: The target is the stage, a layer of it or a name whose images it uses, or the
            stage no longer holds the rig.
    """
    if target.exists() and target.samefile(source):
        raise ValueError("is the stage itself; expected another name for the layer")
    stage = rigs.opened(str(source))
    refuse_what_is_used(stage, source, target)
    stage.SetEditTarget(stage.GetSessionLayer())
    prim = stage.GetPrimAtPath(rig_path)
    if not prim:
        raise ValueError(f"has no {rig_path} any more; import it again")
    variants = prim.GetVariantSets()
    has_variants = variants.HasVariantSet(rigs.VARIANT_SET)
    if has_variants:
        variants.GetVariantSet(rigs.VARIANT_SET).SetVariantSelection(view.representation)
    rig = rigs.read_rig(prim, view.space)
    back = colours.between(view.space, _space_of(rig))
    layer = Sdf.Layer.CreateAnonymous(".usda")
    words = []
    for seen, known in _pairs(rig, view):
        author = _Author(layer, prim, view, known.path, has_variants)
        words += _edits(author, known, seen, rig.place, back)
    if np.abs(view.turn).max() > np.degrees(2 * MOVED):
        _turn(layer, prim, view)
        words.append(f"{rig_path}: turned by {view.turn[0]:.1f} degrees")
    if words:
        _head(layer, stage, source, target)
        if has_variants:
            spec = Sdf.CreatePrimInLayer(layer, rig_path)
            spec.variantSelections[rigs.VARIANT_SET] = view.representation
        _save(layer, target)
    return words


def _space_of(rig: Rig) -> str:
    return rig.colourspace if rig.colourspace in colours.CHROMATICITIES else colours.REC709


def _pairs(rig: Rig, view: View) -> list[tuple[Seen | None, Any]]:
    """Return every light of the stage with what is seen of it; a dome only where one is."""
    seen = {one.path: one for one in view.lights}
    pairs: list[tuple[Seen | None, Any]] = [(seen.get(lamp.path), lamp) for lamp in rig.lamps]
    return pairs + [(seen[dome.path], dome) for dome in rig.domes if dome.path in seen]


@dataclass
class _Author:
    """Overrides attributes of one prim of a layer.

    Attributes:
        layer: The layer.
        rig: The rig's prim in the stage.
        view: Its times.
        path: The prim that is overridden.
        in_variant: Whether that is done in the rig's variant, where the stage says its lights.
    """

    layer: Sdf.Layer
    rig: Usd.Prim
    view: View
    path: str
    in_variant: bool

    @property
    def prim(self) -> Usd.Prim:
        return self.rig.GetStage().GetPrimAtPath(self.path)

    def override(self, name: str, kind: Sdf.ValueTypeName, track: Track, convert: Any) -> None:
        """Override an attribute by the values of a track, each converted to a value of USD."""
        attribute = self.attribute(name, kind)
        attribute.default = convert(track.values[0])
        if not track.is_constant:
            for time, value in zip(track.times.tolist(), track.values, strict=True):
                self.layer.SetTimeSample(attribute.path, time, convert(value))

    def attribute(self, name: str, kind: Sdf.ValueTypeName) -> Sdf.AttributeSpec:
        """Return an attribute of the layer, made if it is not there."""
        path = Sdf.Path(self.path)
        if self.in_variant:
            rig = self.rig.GetPath()
            selected = rig.AppendVariantSelection(rigs.VARIANT_SET, self.view.representation)
            path = path.ReplacePrefix(rig, selected)
        spec = Sdf.CreatePrimInLayer(self.layer, path)
        found = spec.attributes.get(name)
        uniform = Sdf.VariabilityUniform if name == ORDER else Sdf.VariabilityVarying
        return found or Sdf.AttributeSpec(spec, name, kind, uniform)


def _edits(author: _Author, known: Any, seen: Seen | None, rig: Place, back: Array) -> list[str]:
    """Override what is edited of a light; return it in words, one line or none."""
    times = author.view.times
    if seen is None:
        author.override("visibility", Sdf.ValueTypeNames.Token, _still([0.0]), _token)
        return [f"{known.path}: deleted, so invisible"]
    words = _light(author, known, seen, back)
    was = known.visible.held_at(times)[:, 0] > 0
    if (seen.visible != was).any():
        shown = reduced(Track(times, seen.visible.astype(float)[:, None]))
        author.override("visibility", Sdf.ValueTypeNames.Token, shown, _token)
        words.append("hidden" if not seen.visible.any() else "visibility")
    if isinstance(known, Lamp):
        words += _size(author, known, seen)
        words += _place(author, known, seen, rig)
    return [f"{known.path}: {', '.join(words)}"] if words else []


def _light(author: _Author, known: Any, seen: Seen, back: Array) -> list[str]:
    """Override intensity and colour.

    The stage's brightness is divided out of what is seen, so a stage that is normalised, or has an
    exposure, keeps both.
    """
    times = author.view.times
    was = known.brightness.at(times) * known.colour.at(times)
    if not (np.abs(seen.light - was) > EDITED * was.max(-1, keepdims=True)).any():
        return []
    wanted = (seen.light @ back.T).clip(min=0)
    level = wanted.max(-1, keepdims=True)
    sent = known.brightness.at(times)
    intensity = np.array([[_intensity(author.prim, time)] for time in times.tolist()])
    per_intensity = np.where(intensity > 0, sent / np.where(intensity > 0, intensity, 1.0), 1.0)
    new = reduced(Track(times, level / per_intensity))
    author.override("inputs:intensity", Sdf.ValueTypeNames.Float, new, lambda v: float(v[0]))
    lit = level > 0
    tint = np.where(lit, wanted / np.where(lit, level, 1.0), 1.0)
    colour = reduced(Track(times, tint))
    author.override("inputs:color", Sdf.ValueTypeNames.Color3f, colour, lambda v: Gf.Vec3f(*v))
    return _light_words(was, seen.light)


def _light_words(was: Array, now: Array) -> list[str]:
    """Say by how much light is more, and whether its colour is another.  [T, 3]."""
    levels = was.max(-1), now.max(-1)
    both = (levels[0] > 0) & (levels[1] > 0)
    if not both.any():
        return ["light"]
    ratio = levels[1][both] / levels[0][both]
    low, high = ratio.min(), ratio.max()
    words = []
    if max(abs(low - 1), abs(high - 1)) > EDITED:
        span = f"{high:.3g}" if high - low <= EDITED * high else f"{low:.3g} to {high:.3g}"
        words.append(f"light x {span}")
    tints = [light[both] / light[both].max(-1, keepdims=True) for light in (was, now)]
    if np.abs(tints[1] - tints[0]).max() > EDITED:
        words.append("another colour")
    return words


def _intensity(prim: Usd.Prim, time: float) -> float:
    value = prim.GetAttribute("inputs:intensity").Get(time)
    return 1.0 if value is None else float(value)


def _size(author: _Author, known: Lamp, seen: Seen) -> list[str]:
    """Override width and height, or the angle."""
    times = author.view.times
    was = known.size.at(times)
    if known.kind == "card":
        was = was * known.place.scale.at(times)[:, :2]
    if seen.size is None or not (np.abs(seen.size - was) > EDITED * was).any():
        return []
    names = ("width", "height") if known.kind == "card" else ("angle",)
    for index, name in enumerate(names):
        own = seen.size[:, index : index + 1]
        if known.kind == "card":
            own = own / known.place.scale.at(times)[:, index : index + 1]
        values = reduced(Track(times, own))
        author.override(f"inputs:{name}", Sdf.ValueTypeNames.Float, values, lambda v: float(v[0]))
    return [" and ".join(names)]


def _place(author: _Author, known: Lamp, seen: Seen, rig: Place) -> list[str]:
    """Override the transform."""
    if seen.position is None or seen.rotation is None:
        return []
    times = author.view.times
    own = known.place
    was = own.position.at(times) - rig.position.at(times)
    moved = np.zeros(len(times), bool)
    if known.kind == "card":  # where a sun stands does not matter
        far = np.linalg.norm(was, axis=-1)
        moved = np.linalg.norm(seen.position - was, axis=-1) > MOVED * far
    turns = own.rotation.at(times)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    now = seen.rotation / np.linalg.norm(seen.rotation, axis=-1, keepdims=True)
    turned = np.abs((turns * now).sum(-1)) < 1 - MOVED**2 / 2
    if not (moved | turned).any():
        return []
    stage = author.rig.GetStage()
    to_stage = rigs.Y_UP.T if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else np.eye(3)
    attribute = author.attribute(TRANSFORM, Sdf.ValueTypeNames.Matrix4d)
    positions = seen.position if known.kind == "card" else was
    positions = positions + rig.position.at(times)
    for index, time in enumerate(times.tolist()):
        rows = np.eye(4)
        lengths = own.scale.at(np.array([time]))[0]
        rows[:3, :3] = lengths[:, None] * (to_stage @ rigs.rotation_matrix(now[index])).T
        rows[3, :3] = to_stage @ positions[index]
        above = UsdGeom.XformCache(time).GetParentToWorldTransform(author.prim)
        matrix = Gf.Matrix4d(*rows.ravel().tolist()) * above.GetInverse()
        if index == 0:
            attribute.default = matrix
        author.layer.SetTimeSample(attribute.path, time, matrix)
    author.attribute(ORDER, Sdf.ValueTypeNames.TokenArray).default = [TRANSFORM]
    return ["moved" if moved.any() else "turned"]


def _turn(layer: Sdf.Layer, rig: Usd.Prim, view: View) -> None:
    """Turn the rig about the vertical through where it stands, after its other ops.

    What the stage's own turns hold is in the lights as they were imported, so the turn that is seen
    comes on top of them, with a name of its own. Where the frame of the rig's parent is not that of
    the stage at the rig's place, the turn stands between one op and its inverse.
    """
    axis = "Y" if UsdGeom.GetStageUpAxis(rig.GetStage()) == UsdGeom.Tokens.y else "Z"
    author = _Author(layer, rig, view, str(rig.GetPath()), in_variant=False)
    held = rig.GetAttribute(ORDER)
    order = list(held.Get() or ()) if held else []
    count = 1
    while (name := _numbered(TURN.format(axis=axis), count)) in order:
        count += 1
    # an angle that is read from a matrix starts anew after half a turn
    turn = reduced(Track(view.times, np.unwrap(view.turn, period=360.0)[:, None]))
    author.override(name, Sdf.ValueTypeNames.Float, turn, lambda v: float(v[0]))
    ops = [name]
    place = reduced(Track(view.times, _places(rig, view.times).reshape(-1, 16)))
    if not (place.is_constant and np.allclose(place.values, np.eye(4).ravel(), rtol=0, atol=1e-9)):
        about = _numbered(TRANSFORM, count)
        author.override(about, Sdf.ValueTypeNames.Matrix4d, place, lambda v: Gf.Matrix4d(*v))
        ops = [about, name, f"!invert!{about}"]
    resets = [op for op in order if op == RESET]
    kept = [op for op in order if op != RESET]
    author.attribute(ORDER, Sdf.ValueTypeNames.TokenArray).default = [*resets, *ops, *kept]


def _numbered(name: str, count: int) -> str:
    """Return the name of an op; the first has no number."""
    return name if count == 1 else f"{name}{count}"


def _places(rig: Usd.Prim, times: Array) -> Array:
    """Return matrices from the stage's axes at the rig to the rig's parent.  [T] to [T, 4, 4]."""
    found = []
    for time in times.tolist():
        cache = UsdGeom.XformCache(time)
        _, resets = cache.GetLocalTransformation(rig)
        above = Gf.Matrix4d(1) if resets else cache.GetParentToWorldTransform(rig)
        origin = cache.GetLocalToWorldTransform(rig).ExtractTranslation()
        found.append(Gf.Matrix4d(1).SetTranslate(origin) * above.GetInverse())
    return np.array(found)


def _still(values: list[float]) -> Track:
    return Track(np.zeros(1), np.array([values]))


def _token(value: Array) -> str:
    return str(UsdGeom.Tokens.inherited if value[0] else UsdGeom.Tokens.invisible)


def _head(layer: Sdf.Layer, stage: Usd.Stage, source: Path, target: Path) -> None:
    """Lay the layer over the stage and copy what USD does not compose."""
    absolute = os.path.abspath(source)
    try:
        named = Path(os.path.relpath(absolute, os.path.abspath(target.parent))).as_posix()
        named = named if named.startswith("../") else f"./{named}"
    except ValueError:  # another drive of Windows
        named = Path(absolute).as_posix()
    layer.subLayerPaths.append(named)
    below = stage.GetRootLayer()
    for key in STAGE_KEYS:
        if below.pseudoRoot.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, below.pseudoRoot.GetInfo(key))
    layer.defaultPrim = below.defaultPrim


def _save(layer: Sdf.Layer, target: Path) -> None:
    """Write the layer beside its target, and rename it."""
    beside = target.with_name(f".{target.stem}.part{target.suffix}")
    try:
        if not layer.Export(str(beside)):
            raise OSError(f"{target}: could not be written")
        beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)
