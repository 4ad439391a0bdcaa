# SPDX-License-Identifier: Apache-2.0
"""From the lobes of every frame to tracks that are continuous in time."""

from asglight.lobes.data import Lobes
from asglight.lobes.fading import carried_on
from asglight.lobes.identity.main_tracks import kept_on_lamps
from asglight.lobes.identity.parting import held, parted


def on_their_paths(lobes: Lobes) -> Lobes:
    """Return a shot whose tracks are right between its frames, too.

    The oldest track of each lamp stays on it, lobes that are given another place part from their
    tracks, and black lobes lie where their light comes from or goes to.

    Args:
        lobes: A shot; the light of every frame stays as it is.  [F, N, .]
    """
    return held(carried_on(parted(kept_on_lamps(lobes))))
