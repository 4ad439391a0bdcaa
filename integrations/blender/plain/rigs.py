# SPDX-License-Identifier: GPL-3.0-or-later
"""The lights of an asglight stage as data that Blender can be given; needs `pxr`, not `bpy`.

Directions are Blender's, +Z up: of a stage whose up axis is Y, (x, y, z) becomes (x, -z, y).
Colours are linear, in the space asked for. What a light sends is what UsdLux defines
(usdLux/schema.usda): radiance of a card, irradiance on a patch that faces a distant light.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Tf, Usd, UsdGeom, UsdLux

from . import colours
from .tracks import Array, Track, in_one_hemisphere, reduced, times_between, track

LOBE_API = "AsgLobeAPI"
CUSTOM_DATA, VERSION, DISTANCE = "asglight", "version", "distance"
VARIANT_SET = "representation"
KINDS = {"RectLight": "card", "DistantLight": "sun"}

Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From a stage whose up axis is Y to Blender, for column vectors."""


@dataclass(frozen=True)
class Place:
    """Where a prim is, in Blender's directions and the stage's units.

    Attributes:
        position: [T, 3]
        rotation: Unit quaternions, w first, of one hemisphere.  [T, 4]
        scale: Lengths of its axes.  [T, 3]
    """

    position: Track
    rotation: Track
    scale: Track


@dataclass(frozen=True)
class Lamp:
    """A card or a distant light.

    Attributes:
        path: Its prim.
        group: The prim of its lobe or key, which may be its own.
        kind: `card` or `sun`.
        brightness: Radiance of a card, irradiance of a sun, times its colour.  [T, 1]
        colour: [T, 3]
        size: Width and height in the stage's units, or the angle in degrees.  [T, 2 or 1]
        visible: 1, or 0; held.  [T, 1]
        place: Of its prim.
        texture: Whether it has an image, which Blender's lights do not take.
    """

    path: str
    group: str
    kind: str
    brightness: Track
    colour: Track
    size: Track
    visible: Track
    place: Place
    texture: bool


@dataclass(frozen=True)
class Dome:
    """A dome light.

    Attributes:
        path: Its prim.
        brightness: What its image is multiplied by.  [T, 1]
        colour: The same, in each channel.  [T, 3]
        visible: 1, or 0; held.  [T, 1]
        place: Of its prim.
        times: When each image begins.  [T]
        images: Their files, as USD resolves them.  [T]
    """

    path: str
    brightness: Track
    colour: Track
    visible: Track
    place: Place
    times: Array
    images: tuple[str, ...]


@dataclass(frozen=True)
class Rig:
    """All lights of a rig.

    Attributes:
        path: Its prim.
        place: Of its prim.
        groups: Prims of lobes and keys, also of those without a light.
        places: Of each of them.
        lamps: Cards and suns.
        domes: At most one as asglight writes it.
        left: Lights of kinds that asglight does not write.
        distance: Of the cards, in the stage's units.
        colourspace: Color Interop ID of what its images hold.
        representation: What it shows; none where nothing says it.
    """

    path: str
    place: Place
    groups: tuple[str, ...]
    places: dict[str, Place]
    lamps: tuple[Lamp, ...]
    domes: tuple[Dome, ...]
    left: tuple[str, ...]
    distance: float
    colourspace: str
    representation: str


def opened(path: str) -> Usd.Stage:
    """Open a stage as it is on disk now, whatever of it is in memory.

    Raises:
        ValueError: There is none that USD can open.
    """
    if not Path(path).is_file():
        raise ValueError("no such file; expected a stage that asglight wrote")
    try:
        stage = Usd.Stage.Open(path)
        stage.Reload()
    except Tf.ErrorException as error:
        raise ValueError("is damaged, or no stage; USD cannot open it") from error
    return stage


def rig_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """Return the rigs of a stage: prims with asglight's data and lobes below them."""
    found = []
    for prim in stage.Traverse():
        data = prim.GetCustomDataByKey(CUSTOM_DATA)
        if isinstance(data, dict) and VERSION in data:
            found.append(prim)
    return found


def representations(rig: Usd.Prim) -> list[str]:
    """Return what a rig can show, the one that it shows first."""
    variants = rig.GetVariantSets()
    if variants.HasVariantSet(VARIANT_SET):
        chosen = variants.GetVariantSelection(VARIANT_SET)
        names = variants.GetVariantSet(VARIANT_SET).GetVariantNames()
        return [chosen, *(name for name in names if name != chosen)] if chosen else list(names)
    alone = (rig.GetCustomDataByKey(CUSTOM_DATA) or {}).get(VARIANT_SET)
    return [str(alone)] if alone else []


def read_rig(rig: Usd.Prim, target_space: str = colours.REC709) -> Rig:
    """Read what a rig shows.

    Args:
        rig: One of `rig_prims`.
        target_space: Color Interop ID of the colours that are wanted.
    """
    space = _get(rig, "colorSpace:name", 0.0, colours.REC709)
    known = space if space in colours.CHROMATICITIES else colours.REC709
    reader = _Reader(rig.GetStage(), colours.between(known, target_space))
    groups, lamps, domes, left = [], [], [], []
    for prim in Usd.PrimRange(rig):
        group = _group(prim, rig)
        if group == prim:
            groups.append(str(prim.GetPath()))
        if prim.GetTypeName() in KINDS:
            lamps.append(reader.lamp(prim, group or prim))
        elif prim.IsA(UsdLux.DomeLight):
            domes.append(reader.dome(prim))
        elif prim.HasAPI(UsdLux.LightAPI):
            left.append(str(prim.GetPath()))
    places = {path: reader.place(rig.GetStage().GetPrimAtPath(path)) for path in groups}
    data = rig.GetCustomDataByKey(CUSTOM_DATA)
    return Rig(
        str(rig.GetPath()),
        reader.place(rig),
        tuple(groups),
        places,
        tuple(lamps),
        tuple(domes),
        tuple(left),
        float(data.get(DISTANCE, 0.0)),
        str(space),
        next(iter(representations(rig)), ""),
    )


def _group(prim: Usd.Prim, rig: Usd.Prim) -> Usd.Prim | None:
    """Return the lobe or key of a prim: what lies in a scope of the rig."""
    while prim and prim != rig:
        parent = prim.GetParent()
        if parent and parent.IsA(UsdGeom.Scope) and parent.GetParent() == rig:
            return prim
        prim = parent
    return None


class _Reader:
    """Reads prims of one stage.

    Attributes:
        stage: The stage.
        matrix: From its colours to those wanted.  [3, 3]
        axes: From its directions to Blender's.  [3, 3]
    """

    def __init__(self, stage: Usd.Stage, matrix: Array) -> None:
        self.stage = stage
        self.matrix = matrix
        self.axes = Y_UP if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else np.eye(3)

    def lamp(self, prim: Usd.Prim, group: Usd.Prim) -> Lamp:
        kind = KINDS[prim.GetTypeName()]
        place = self.place(prim)
        names = ("inputs:width", "inputs:height") if kind == "card" else ("inputs:angle",)
        size = _values(prim, names)
        normalize = bool(prim.GetAttribute("inputs:normalize").Get())
        names = (
            "inputs:intensity",
            "inputs:exposure",
            *(names if normalize or kind == "sun" else ()),
        )
        area = _area(place) if kind == "card" else 1.0

        def brightness(time: float) -> list[float]:
            intensity, exposure, *sizes = (_number(prim, name, time) for name in names)
            value = intensity * 2.0**exposure
            if kind == "card":
                return [value / (sizes[0] * sizes[1] * area) if normalize else value]
            return [value if normalize else value * _disc(sizes[0])]

        sent = track(_times(prim, names), brightness)
        image = prim.GetAttribute("inputs:texture:file")
        textured = bool(image and image.Get())
        own = str(prim.GetPath()), str(group.GetPath())
        return Lamp(*own, kind, sent, self._colour(prim), size, _visible(prim), place, textured)

    def dome(self, prim: Usd.Prim) -> Dome:
        names = ("inputs:intensity", "inputs:exposure")
        sent = track(
            _times(prim, names),
            lambda time: [_number(prim, names[0], time) * 2.0 ** _number(prim, names[1], time)],
        )
        image = prim.GetAttribute("inputs:texture:file")
        times = image.GetTimeSamples() if image else []
        found = [image.Get(time) for time in times or [Usd.TimeCode.Default()]] if image else []
        paths = tuple(asset.resolvedPath or asset.path for asset in found if asset)
        begins = np.array(times or [0.0])
        place = self.place(prim)
        path = str(prim.GetPath())
        return Dome(path, sent, self._colour(prim), _visible(prim), place, begins, paths)

    def place(self, prim: Usd.Prim) -> Place:
        """Return where a prim is; between its samples there are more where it turns far."""
        chain = [one for one in _ancestry(prim) if one.IsA(UsdGeom.Xformable)]
        times = sorted({t for one in chain for t in UsdGeom.Xformable(one).GetTimeSamples()})
        when = np.array(times or [0.0])
        rows = self._rows(prim, when)
        more = np.array(times_between(when, self._parts(rows)[1]))
        if len(more):
            when = np.concatenate([when, more])
            order = np.argsort(when, kind="stable")
            when, rows = when[order], np.concatenate([rows, self._rows(prim, more)])[order]
        position, turns, scale = self._parts(rows)
        parts = (position, in_one_hemisphere(turns), scale)
        return Place(*(reduced(Track(when, part)) for part in parts))

    def _rows(self, prim: Usd.Prim, times: Array) -> Array:
        """Return the matrices from a prim to the stage, for row vectors.  [T] to [T, 4, 4]."""
        caches = (UsdGeom.XformCache(time) for time in times.tolist())
        return np.array([cache.GetLocalToWorldTransform(prim) for cache in caches])

    def _parts(self, rows: Array) -> tuple[Array, Array, Array]:
        """Return positions, rotations and scales of matrices.  [T, 3], [T, 4], [T, 3]."""
        scale = np.linalg.norm(rows[:, :3, :3], axis=-1)
        unit = rows[:, :3, :3] / np.maximum(scale, np.finfo(float).tiny)[..., None]
        axes = self.axes @ np.swapaxes(unit, -1, -2)
        return rows[:, 3, :3] @ self.axes.T, quaternions(axes), scale

    def _colour(self, prim: Usd.Prim) -> Track:
        names = ("inputs:color", "inputs:colorTemperature")
        warmed = bool(prim.GetAttribute("inputs:enableColorTemperature").Get())

        def colour(time: float) -> Array:
            value = np.array(_get(prim, names[0], time, (1.0, 1.0, 1.0)))
            if warmed:
                kelvin = _number(prim, names[1], time)
                value = value * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin))
            return (self.matrix @ value).clip(min=0)

        return track(_times(prim, names if warmed else names[:1]), colour)


def quaternions(axes: Array) -> Array:
    """Return the rotations nearest to some axes, w first.

    Args:
        axes: For column vectors; a mirrored frame becomes one without, as mirroring a light in its
            x changes nothing.  [T, 3, 3]

    Returns:
        [T, 4]
    """
    left, _, right = np.linalg.svd(axes)
    turns = left @ right
    turns[:, :, 0] *= np.linalg.det(turns)[:, None]
    found = [Gf.Matrix3d(*turn.T.ravel().tolist()).ExtractRotation().GetQuat() for turn in turns]
    return np.array([[one.GetReal(), *one.GetImaginary()] for one in found])


def rotation_matrix(turn: Sequence[float]) -> Array:
    """Return the matrix of a unit quaternion, w first, for column vectors.  [4] to [3, 3]."""
    real, *imaginary = (float(part) for part in turn)
    rows = Gf.Matrix3d(Gf.Quatd(real, Gf.Vec3d(*imaginary)))
    return np.array(rows).T


def _area(place: Place) -> float:
    """Return what scaling makes of a unit of a card's area."""
    return float(place.scale.values[0, :2].prod())


def _disc(angle_deg: float) -> float:
    """Return what a distant light's radiance is multiplied by to be irradiance: pi sin^2."""
    return float(np.pi * np.sin(np.radians(angle_deg) / 2) ** 2) if angle_deg > 0 else 1.0


def _visible(prim: Usd.Prim) -> Track:
    imageable = UsdGeom.Imageable(prim)
    times = {t for one in _ancestry(prim) for t in _times(one, ("visibility",))}

    def visible(time: float) -> list[float]:
        return [float(imageable.ComputeVisibility(time) != UsdGeom.Tokens.invisible)]

    return track(times, visible)


def _values(prim: Usd.Prim, names: Sequence[str]) -> Track:
    return track(_times(prim, names), lambda time: [_number(prim, name, time) for name in names])


def _times(prim: Usd.Prim, names: Sequence[str]) -> set[float]:
    return {time for name in names for time in prim.GetAttribute(name).GetTimeSamples()}


_FALLBACKS = {
    "inputs:intensity": 1.0,
    "inputs:exposure": 0.0,
    "inputs:width": 1.0,
    "inputs:height": 1.0,
    "inputs:angle": 0.53,
    "inputs:colorTemperature": 6500.0,
}
"""Of usdLux/schema.usda."""


def _number(prim: Usd.Prim, name: str, time: float) -> float:
    return float(_get(prim, name, time, _FALLBACKS[name]))


def _get(prim: Usd.Prim, name: str, time: float, otherwise: Any) -> Any:
    attribute = prim.GetAttribute(name)
    value = attribute.Get(time) if attribute else None
    return otherwise if value is None else value


def _ancestry(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()
