# SPDX-License-Identifier: Apache-2.0
"""Lobes that the tests of this folder share, built without the code under test."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from asglight.lobes import Form, Lobes

FORMS = list(Form)
ANISOTROPIC = [Form.ASG, Form.BINGHAM]


def double(values: object) -> torch.Tensor:
    return torch.as_tensor(np.asarray(values), dtype=torch.float64)


def random_rotations(count: int, seed: int = 0) -> Rotation:
    """Return uniformly random rotations: the directions of normal 4-vectors."""
    return Rotation.from_quat(np.random.default_rng(seed).normal(size=(count, 4)))


def random_axes(count: int, seed: int = 0) -> torch.Tensor:
    """Return random right-handed frames, rows x, y, z, in float64.  [count, 3, 3]."""
    return double(random_rotations(count, seed).as_matrix())


def pointing(directions: list[tuple[float, float, float]], seed: int = 0) -> torch.Tensor:
    """Return frames with the given z axes and a random turn about them.  [N, 3, 3]."""
    frames = []
    rng = np.random.default_rng(seed)
    for direction in directions:
        z = np.asarray(direction) / np.linalg.norm(direction)
        x = np.cross(rng.normal(size=3), z)
        x /= np.linalg.norm(x)
        frames.append(np.stack([x, np.cross(z, x), z]))
    return double(np.stack(frames))


def lobes_of(
    axes: torch.Tensor, sharpness: object, form: Form, amplitude: object = (1.0, 1.0, 1.0)
) -> Lobes:
    """Return float64 lobes; sharpness and amplitude are repeated for every frame."""
    count = axes.shape[:-2]
    s = double(sharpness)
    if form is Form.SG:
        s = s[..., :1].expand(*s.shape[:-1], 2)
    return Lobes(
        axes=axes,
        sharpness=s.expand(*count, 2).clone(),
        amplitude=double(amplitude).expand(*count, 3).clone(),
        form=form,
    )


def random_lobes(count: int, form: Form, seed: int = 0) -> Lobes:
    """Return lobes of random frames, sharpness 0.1 to 1000 and colours.  [count, .]."""
    rng = np.random.default_rng(seed)
    sharpness = 10 ** rng.uniform(-1, 3, size=(count, 2))
    return lobes_of(
        random_axes(count, seed), sharpness, form, rng.lognormal(size=(count, 3)) + 0.01
    )


def random_directions(count: int, seed: int = 0) -> torch.Tensor:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return double(points / np.linalg.norm(points, axis=1, keepdims=True))


def flat_top(gaussian: np.ndarray) -> np.ndarray:
    """Return 1 - (1 - E)^3 with the digits of a small E."""
    with np.errstate(divide="ignore"):  # E = 1, where log1p is -infinity and the value is 1
        return -np.expm1(3 * np.log1p(-gaussian))


def value_of(form: Form, axes: np.ndarray, s: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Evaluate the defining formula of one unit lobe in numpy.  [P]."""
    x, y, z = d @ axes[0], d @ axes[1], d @ axes[2]
    if form is Form.SG:
        return np.exp(s[0] * (z - 1))
    gaussian = np.exp(-s[0] * x**2 - s[1] * y**2)
    if form is Form.FLAT:
        return flat_top(gaussian) * np.maximum(z, 0)
    return gaussian * np.maximum(z, 0) if form is Form.ASG else gaussian
