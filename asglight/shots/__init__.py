# SPDX-License-Identifier: Apache-2.0
"""A shot as a job: read, fit, checkpoint, resume, write.

The names load what they need when they are first used: whoever watches a shot needs no fitter.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asglight.shots.job import ShotResult, fit_sequence, fit_shot

__all__ = ["ShotResult", "fit_sequence", "fit_shot"]


def __getattr__(name: str) -> Any:
    """Load a public name."""
    if name not in __all__:
        raise AttributeError(f"module 'asglight.shots' has no attribute {name!r}")
    value = getattr(importlib.import_module("asglight.shots.job"), name)
    globals()[name] = value
    return value
