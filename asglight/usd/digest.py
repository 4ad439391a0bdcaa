# SPDX-License-Identifier: Apache-2.0
"""A digest of what a lobe is, kept with it, that tells whether somebody overrode it.

A CRC-32 of the float32 values of its tracks: default first, then samples. Times are left out, so
that a shot may be retimed.
"""

import zlib
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from asglight.usd import schema
from asglight.usd.stage import numbers, sampled_values


def digest_of_values(tracks: Iterable[NDArray[np.float32]]) -> str:
    """Return the digest of the tracks of a lobe, each the default and then the samples.  [., K]."""
    digest = 0
    for values in tracks:
        digest = zlib.crc32(values.astype("<f4").tobytes(), digest)
    return f"{digest:08x}"


def author_digest(lobe: Sdf.PrimSpec, digest: str) -> None:
    """Keep a digest with a lobe."""
    lobe.SetInfo("customData", {schema.CUSTOM_DATA: {schema.DIGEST: digest}})


def digest_of_prim(lobe: Usd.Prim) -> str:
    """Return the digest of what a lobe is now."""
    tracks = []
    for name in (*schema.LOBE_TRACKS, *schema.SLANT_TRACKS):
        attribute = lobe.GetAttribute(name)
        if name in schema.SLANT_TRACKS and not attribute:
            continue
        found = numbers(sampled_values(attribute), schema.VALUE_TYPES[name])
        tracks.append(found.astype(np.float32))
    return digest_of_values(tracks)


def has_own_edits(lobe: Usd.Prim) -> bool:
    """Tell whether a lobe is something else than what was written."""
    data = lobe.GetCustomDataByKey(schema.CUSTOM_DATA)
    return isinstance(data, dict) and data.get(schema.DIGEST) not in (None, digest_of_prim(lobe))
