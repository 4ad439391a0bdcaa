# SPDX-License-Identifier: Apache-2.0
"""HDR environment sequences as a few anisotropic spherical Gaussian lights, in time-sampled USD.

Examples:
    >>> import asglight
    >>> tracks = asglight.fit_sequence("sky.####.exr", lobes=2)
    >>> report = asglight.write_usd(tracks, "sky.usda")
    >>> asglight.read_usd("sky.usda").frames
    (1001, 1002)
    >>> up = asglight.irradiance(tracks, [0.0, 1.0, 0.0], time=1001.5)  # [3]

docs/guides/python.md shows all of it.

The names load what they need when they are first used: `import asglight` alone loads neither torch
nor pxr.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asglight.arrays.fit import fit
    from asglight.arrays.follower import Follower
    from asglight.arrays.light import balls, irradiance, latlong, radiance
    from asglight.arrays.plot import plot
    from asglight.errors import InputError
    from asglight.lobes import Lobes, LobeTracks
    from asglight.lobes.resampling import resampled
    from asglight.shots import fit_sequence
    from asglight.usd import read_usd, write_usd

__version__ = "0.2.0"

__all__ = [
    "Follower",
    "InputError",
    "LobeTracks",
    "Lobes",
    "__version__",
    "balls",
    "fit",
    "fit_sequence",
    "irradiance",
    "latlong",
    "plot",
    "radiance",
    "read_usd",
    "resampled",
    "write_usd",
]

_HOME = {
    "Follower": "asglight.arrays.follower",
    "InputError": "asglight.errors",
    "LobeTracks": "asglight.lobes",
    "Lobes": "asglight.lobes",
    "balls": "asglight.arrays.light",
    "fit": "asglight.arrays.fit",
    "fit_sequence": "asglight.shots",
    "irradiance": "asglight.arrays.light",
    "latlong": "asglight.arrays.light",
    "plot": "asglight.arrays.plot",
    "radiance": "asglight.arrays.light",
    "read_usd": "asglight.usd",
    "resampled": "asglight.lobes.resampling",
    "write_usd": "asglight.usd",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its room."""
    if name not in _HOME:
        raise AttributeError(f"module 'asglight' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *_HOME})
