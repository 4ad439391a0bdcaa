# SPDX-License-Identifier: Apache-2.0
"""What is looked at when lights are read: a rig, its frames, and the values of its lights there.

Dimension letters: F frames, S sizes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux

from asglight.images import ocio
from asglight.lobes import Lobes, asg, motion
from asglight.usd import schema
from asglight.usd.lights import cards, distant
from asglight.usd.lights.light import Light
from asglight.usd.read.placement import Placement, world_matrices
from asglight.usd.read.times import are_frames
from asglight.usd.schema import Representation
from asglight.usd.stage import numbers, prims_below

ENABLE_TEMPERATURE, TEMPERATURE = "inputs:enableColorTemperature", "inputs:colorTemperature"
DIFFUSE, SPECULAR = "inputs:diffuse", "inputs:specular"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """What is looked at.

    Attributes:
        rig: The prim that holds the lobes.
        times: Frame numbers.  F
        representation: The variant that is selected.
        distance: Of the cards as written.
        placement: How the rig stands in the stage.
        colorspace: Color Interop ID of the rig's colours.
        kinds: Of each lobe in `cards`.
        threefold: Of each lobe in `distant`: whether it has three lights.
    """

    rig: Usd.Prim
    times: tuple[int, ...]
    representation: Representation
    distance: float
    placement: Placement
    colorspace: str = ocio.REC709
    kinds: Sequence[cards.Kind] = ()
    threefold: Sequence[bool] = ()

    @property
    def is_cards(self) -> bool:
        """Tell whether lights are cards."""
        return self.representation is Representation.CARDS

    @property
    def size_names(self) -> tuple[str, ...]:
        """Return the attributes that say how large a light is."""
        return (schema.WIDTH, schema.HEIGHT) if self.is_cards else (schema.ANGLE,)

    def spread(self, sizes: Array) -> Array:
        """Return the squared sines of half the angles that lights are seen under.  [F, S]."""
        if self.is_cards:
            squares = (sizes / (2 * self.distance)) ** 2
            return squares / (1 + squares)
        return np.sin(np.radians(np.minimum(sizes, 180.0)) / 2) ** 2

    def lights(self, lobes: Lobes, indices: Sequence[int]) -> list[list[Light]]:
        """Return the lights that `write_usd` would author, of the kinds that the stage has.

        Args:
            lobes: Those of the indices.  [F, N, .]
            indices: Of the lobes in the stage.
        """
        lobes = motion.resting(lobes)
        moments = asg.moments(lobes.to(torch.float64))
        if self.is_cards:
            return cards.lights(
                lobes, moments, self.distance, [self.kinds[index] for index in indices]
            )
        return distant.lights(lobes, moments, [self.threefold[index] for index in indices])

    def values(self, prim: Usd.Prim, name: str, fallback: object) -> Array:
        """Return an attribute at every frame, or what stands for one without a value.  [F, K]."""
        attribute = prim.GetAttribute(name)
        query = Usd.AttributeQuery(attribute) if attribute else None
        varies = query is not None and query.ValueMightBeTimeVarying()
        times = self.times if varies else self.times[:1]
        found = [query.Get(time) if query else None for time in times]
        rows = [fallback if value is None else value for value in found]
        kind = schema.VALUE_TYPES.get(name, Sdf.ValueTypeNames.Float)
        if kind == Sdf.ValueTypeNames.Bool:
            rows, kind = [float(bool(row)) for row in rows], Sdf.ValueTypeNames.Float
        return np.repeat(numbers(rows, kind), 1 if varies else len(self.times), axis=0)

    def brightness(self, light: Usd.Prim) -> Array:
        """Return intensity, exposure, colour and its temperature together, as UsdLux does.

        Multipliers of what materials reflect count where they are the same for all. The colours
        are the rig's.  [F, 3]
        """
        color = self.values(light, schema.COLOR, Gf.Vec3f(1)) @ self._to_rig(light).T
        warmth = self.values(light, ENABLE_TEMPERATURE, False)
        if warmth.any():
            kelvin = self.values(light, TEMPERATURE, 6500.0)[:, 0]
            body = {one: UsdLux.BlackbodyTemperatureAsRgb(one) for one in set(kelvin.tolist())}
            # the colours of bodies are linear Rec.709, and are multiplied there
            to_709 = ocio.matrix(self.colorspace, ocio.REC709)
            shone = color @ to_709.T * np.array([body[one] for one in kelvin.tolist()])
            color = np.where(warmth > 0, np.maximum(shone @ np.linalg.inv(to_709).T, 0.0), color)
        diffuse, specular = self.values(light, DIFFUSE, 1.0), self.values(light, SPECULAR, 1.0)
        return (
            self.values(light, schema.INTENSITY, 1.0)
            * color
            * 2.0 ** self.values(light, schema.EXPOSURE, 0.0)
            * np.where(diffuse == specular, diffuse, 1.0)
        )

    def _to_rig(self, light: Usd.Prim) -> Array:
        """Return the matrix from a light's colours to the rig's, for column vectors.  [3, 3]."""
        attribute = light.GetAttribute(schema.COLOR)
        stated = attribute and Usd.ColorSpaceAPI.ComputeColorSpaceName(
            attribute, Usd.ColorSpaceHashCache()
        )
        known = stated if stated in ocio.NAMES else self.colorspace
        return ocio.matrix(known, self.colorspace)

    def sampled(self, prim: Usd.Prim) -> NDArray[np.bool_]:
        """Tell in which frames a lobe or a light of its has samples; in all where none has.  [F].

        Between the frames of the rig nobody has written anything, as in a shot that runs slower.
        There lights are what USD interpolates, and that is the interpolated lobe's light to a few
        thousandths only.
        """
        codes: set[float] = set()
        for one in prims_below(prim):
            for attribute in one.GetAuthoredAttributes():
                codes.update(attribute.GetTimeSamples())
        met = np.array([float(time) in codes for time in self.times])
        met &= np.array(are_frames(self.rig, self.times))
        return met if met.any() else np.ones(len(met), dtype=bool)

    def world(self, prim: Usd.Prim) -> Array:
        """Return the transform of a prim to the stage.  [F, 4, 4]."""
        return world_matrices(prim, self.times)

    def hidden(self, prim: Usd.Prim) -> NDArray[np.bool_]:
        """Tell in which frames a prim itself is invisible, whatever those above it are.  [F]."""
        attribute = prim.GetAttribute(UsdGeom.Tokens.visibility)
        if not attribute or not attribute.HasAuthoredValue():
            return np.zeros(len(self.times), dtype=bool)
        return np.array([attribute.Get(time) == UsdGeom.Tokens.invisible for time in self.times])
