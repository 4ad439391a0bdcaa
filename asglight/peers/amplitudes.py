# SPDX-License-Identifier: Apache-2.0
"""Amplitudes of given lobes by linear least squares over the sphere.

With the lobes' values B [N, P] and solid angles omega, the error sum omega |a B - L|^2 depends on
the amplitudes a through the N x N Gram matrix B omega B^T and the moments B omega L alone, so maps
of any size are solved alike.
"""

import numpy as np
import scipy.optimize
import torch
from torch import Tensor

RIDGE = 1e-9
"""Of the largest diagonal entry, added to the diagonal: two equal lobes share their light instead
of taking any difference of large numbers; the amplitudes of others change by as little."""


def solve(values: Tensor, weighted: Tensor, radiance: Tensor, *, signed: bool) -> Tensor:
    """Return the amplitudes of least squared error.

    Args:
        values: Each lobe of amplitude 1.  [N, P]
        weighted: The same times solid angle.  [N, P]
        radiance: What is to be matched.  [P, 3]
        signed: Whether amplitudes may be negative; otherwise they are solved by non-negative least
            squares [Lawson and Hanson 1974, "Solving least squares problems"], a channel at a time.

    Returns:
        Amplitudes of the dtype of the radiance.  [N, 3]
    """
    gram = (weighted @ values.mT).double()
    moments = (weighted @ radiance).double()
    gram = gram + RIDGE * float(gram.diagonal().max()) * torch.eye(len(gram), dtype=gram.dtype)
    factor = torch.linalg.cholesky(gram)
    if signed:
        return torch.cholesky_solve(moments, factor).to(radiance)
    # |a L - L^-1 m|^2 is the same error but for a constant, in N equations
    right = torch.linalg.solve_triangular(factor, moments, upper=False).numpy()
    columns = [scipy.optimize.nnls(factor.mT.numpy(), right[:, c])[0] for c in range(3)]
    return torch.from_numpy(np.stack(columns, axis=-1)).to(radiance)
