# SPDX-License-Identifier: Apache-2.0
"""Tracks for the tests, made with scipy rotations; and what asglight.usd wrote, read by pxr."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Sdf
from scipy.spatial.transform import Rotation

from asglight.lobes import Form, Lobes, LobeTracks
from asglight.usd import WriteReport, write_usd
from asglight.usd.options import OF_LOBES

SHAPES = ((5.0, 2.0), (20.0, 5.0), (50.0, 2.0), (200.0, 20.0))
METADATA = {
    "version": "0.1.0",
    "preset": "fast",
    "seed": None,
    "errors": [{"frame": 1001, "env": 0.125}, {"frame": 1002, "env": 0.25}],
    "options": {"lobes": 3, "smooth": True, "weights": [1, 0.5]},
    "source": "sky.####.exr — größer",
}


def rows(rotations: Rotation) -> NDArray[np.float64]:
    """Return axis_x, axis_y, axis_z as rows: the images of +X, +Y, +Z."""
    return np.swapaxes(rotations.as_matrix(), -1, -2)


def moving(
    frames: Sequence[int],
    lobes: int = 3,
    form: Form = Form.ASG,
    *,
    jitter: float = 0.0,
    seed: int = 0,
) -> LobeTracks:
    """Return lobes that turn, sharpen and brighten; `jitter` adds that much noise to all of it."""
    random = np.random.default_rng(seed)
    time = np.linspace(0, 1, len(frames))[:, None, None]  # [F, 1, 1]
    start = Rotation.random(lobes, rng=random).as_quat()
    spin = random.uniform(-3, 3, (1, lobes, 3)) * time + jitter * random.normal(
        size=(len(frames), lobes, 3)
    )
    turns = Rotation.from_rotvec(spin.reshape(-1, 3)) * Rotation.from_quat(
        np.tile(start, (len(frames), 1))
    )
    phase = random.uniform(0, 6, (1, lobes, 1))
    noise = np.exp(jitter * random.normal(size=(2, len(frames), lobes, 3)))
    sharpness = np.exp(3 + 1.5 * np.sin(phase + 3 * time)) * noise[0, ..., :2] * [1.5, 0.5]
    if form is Form.SG:
        sharpness = np.repeat(sharpness[..., :1], 2, axis=-1)
    tint = random.uniform(0.2, 1, (1, lobes, 3))
    amplitude = np.exp(1 + np.sin(2 * phase + 5 * time)) * noise[1] * tint
    return LobeTracks(
        tuple(frames),
        24.0,
        Lobes(
            torch.from_numpy(rows(turns).reshape(len(frames), lobes, 3, 3)).float(),
            torch.from_numpy(sharpness).float(),
            torch.from_numpy(amplitude).float(),
            form,
        ),
        METADATA,
    )


def beginning(tracks: LobeTracks, count: int) -> LobeTracks:
    """Return the first frames of a shot."""
    return replace(tracks, frames=tracks.frames[:count], lobes=tracks.lobes[:count])


def of_every_kind(frames: Sequence[int], form: Form = Form.ASG) -> LobeTracks:
    """Return a broad, a soft and a sharp lobe that move: in the fill, three cards, one card."""
    tracks = moving(frames, form=form)
    tracks.lobes.sharpness[:] *= torch.tensor([0.02, 3.0, 300.0])[:, None]
    return tracks


def still(shapes: Sequence[tuple[float, float]] = SHAPES, form: Form = Form.ASG) -> LobeTracks:
    """Return one frame with a lobe of each sharpness, turned at random, of three colours."""
    axes = rows(Rotation.random(len(shapes), rng=np.random.default_rng(5)))
    colors = [[1.0, 2.0, 4.0], [3.0, 1.0, 0.5], [0.0, 0.7, 0.1], [900.0, 800.0, 500.0]]
    return LobeTracks(
        (1001,),
        25.0,
        Lobes(
            torch.from_numpy(axes)[None].float(),
            torch.tensor([shapes]),
            torch.tensor([colors[: len(shapes)]]),
            form,
        ),
    )


def edited(path: Path, edit: Callable[[Sdf.Layer], None]) -> Path:
    """Change a layer on disk."""
    layer = Sdf.Layer.OpenAsAnonymous(str(path))
    edit(layer)
    layer.Export(str(path))
    return path


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files under a folder by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def precision(tracks: LobeTracks) -> np.ndarray:
    """Return sx x x^T + sy y y^T, relative to its largest entry; equal frames give the same."""
    axes, sharpness = tracks.lobes.axes.double(), tracks.lobes.sharpness.double()
    matrix = torch.einsum("fnk,fnki,fnkj->fnij", sharpness, axes[..., :2, :], axes[..., :2, :])
    return (matrix / sharpness.amax(-1)[..., None, None]).numpy()


def assert_same(back: LobeTracks, tracks: LobeTracks) -> None:
    assert back.frames == tracks.frames
    assert back.fps == tracks.fps
    assert back.lobes.form is tracks.lobes.form
    assert back.metadata == tracks.metadata
    np.testing.assert_allclose(back.lobes.amplitude, tracks.lobes.amplitude, rtol=1.1e-6)
    np.testing.assert_allclose(
        back.lobes.sharpness.sort(-1).values, tracks.lobes.sharpness.sort(-1).values, rtol=1.1e-6
    )
    axis_z, wanted = back.lobes.axis_z.double(), tracks.lobes.axis_z.double()
    if tracks.lobes.form is Form.BINGHAM:
        axis_z = axis_z * (axis_z * wanted).sum(-1, keepdim=True).sign()
    np.testing.assert_allclose(axis_z, wanted, atol=1e-6)
    if tracks.lobes.form is not Form.SG:  # an sg has no x and y of its own
        np.testing.assert_allclose(precision(back), precision(tracks), atol=2e-6)


def write_every(
    tracks: LobeTracks, path: Path | str, representation: str = "cards", **options: Any
) -> WriteReport:
    """Write a stage of every representation, which opens with one of them."""
    others = (one for one in OF_LOBES if one != representation)
    return write_usd(tracks, path, **{"representations": (representation, *others), **options})
