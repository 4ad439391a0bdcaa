# SPDX-License-Identifier: Apache-2.0
"""From the lobes of every frame to tracks that are right between the frames, too."""

from asglight.lobes.data import Lobes
from asglight.lobes.fading import carried_on
from asglight.lobes.identity.fragments import fragments_joined
from asglight.lobes.identity.main_tracks import kept_on_lamps
from asglight.lobes.identity.switches import fading_in_place, switches_apart


def as_tracks(lobes: Lobes) -> Lobes:
    """Return a shot, continuous in time; the light of every frame stays as it is.

    The oldest track of each lamp stays on it. A lobe that is given another place goes on in another
    track, and a lamp that left its lobe behind in its own. A black lobe lies where its light comes
    from or goes to.

    Args:
        lobes: As they were fitted.  [F, N, .]
    """
    paths = fragments_joined(switches_apart(kept_on_lamps(lobes)))
    return fading_in_place(carried_on(paths))
