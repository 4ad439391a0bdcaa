# SPDX-License-Identifier: Apache-2.0
"""What the pictures that are compared are called."""

from asglight.viewer.state.display import Subject
from asglight.viewer.state.viewer_state import ViewerState


def titles(state: ViewerState) -> tuple[str, str, str]:
    """Return what fit, reference and, of A and B, the truth of both are called."""
    names = {
        Subject.TOTAL: ("Fit", "Reference (HDRI)"),
        Subject.FIT: ("Fit, sampled", "Reference (HDRI)"),
        Subject.SHADING: ("Fit", "Fit, sampled"),
        Subject.AGAINST: ("A", "B"),
    }
    fit, reference = names[state.subject]
    held = f": {state.reference_label}" if state.reference_label else ""
    truth = f"Reference (HDRI){held}"
    if state.against is not None and state.subject is Subject.AGAINST:
        reference = state.against.label(state.playback.time)
    else:
        reference += held
    if not state.is_fitted:
        fit += ": not there yet" if state.is_fitting else ": none of this frame"
    return fit, reference, truth
