# SPDX-License-Identifier: Apache-2.0
"""Frames of a sequence are alike: the same layer, size and colours by name, the same white."""

from asglight.errors import InputError
from asglight.images.decoding.header import Header
from asglight.images.message import shown


def check_same(
    header: Header, frame: int, model: Header, first: int, height: int | None = None
) -> None:
    """Refuse a frame that is read as another image than the first frame is.

    Colours that both state may differ, for both are converted. What only one states is a file that
    lost its statement: the other means the same and does not say so.

    Args:
        header: Of the frame.
        frame: Its number.
        model: Of the first frame.
        first: Its number.
        height: Rows that larger images are reduced to; None where they keep their size.

    Raises:
        InputError: They differ; it says which frame and how to go on.
    """
    rows, expected = header.height, model.height
    if height is not None:
        rows, expected = min(rows, height), min(expected, height)
    if rows != expected:
        raise _differs(
            header,
            frame,
            f"is {2 * rows} x {rows}",
            f"{2 * expected} x {expected} as frame {first} is. Render or resize it to match",
        )
    if header.layer.label != model.layer.label or header.eye != model.eye:
        raise _differs(
            header,
            frame,
            f"has {_image(header)}",
            f"{_image(model)} as frame {first} has. Choose one for all with --layer or --eye",
        )
    if bool(header.colour.said_by) != bool(model.colour.said_by):
        raise _differs(
            header,
            frame,
            f"is in {header.colour.sentence()}",
            f"{model.colour.sentence()} as frame {first} is. Say what all are in with "
            "--input-colorspace",
        )
    if header.white_luminance != model.white_luminance:
        raise _differs(
            header,
            frame,
            f"has a whiteLuminance of {_nits(header)}",
            f"{_nits(model)} as frame {first} has, for radiance is relative. Bring them to one",
        )


def _differs(header: Header, frame: int, found: str, expected: str) -> InputError:
    return InputError(f"{shown(header.path)}: frame {frame} {found}; expected {expected}.")


def _image(header: Header) -> str:
    eye = f" of the {header.eye} eye" if header.eye else ""
    return f"layer {shown(header.layer.label)}{eye}"


def _nits(header: Header) -> str:
    return "none" if header.white_luminance is None else f"{header.white_luminance:.4g}"
