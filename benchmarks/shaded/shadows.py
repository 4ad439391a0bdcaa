# SPDX-License-Identifier: Apache-2.0
"""Measure soft shadows in closed form against rays, under one lobe at a time.

Errors of the irradiance of the ground in and around the shadow of a ball and of a post, in percent
of what a patch that faces the lobe would get: their mean, what 95 % are below, and the largest. The
lobes have every width from a third of the sky to the sun, and ratios of up to 30.

    python -m benchmarks.shaded.shadows
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asglight.lobes import Form

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import shadow_cases  # rays share nothing with the formula  # isort: skip

FORMS = (Form.ASG, Form.BINGHAM, Form.SG)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lobes", type=int, default=300, help="lobes of each form (300)")
    options = parser.parse_args(argv)
    print("| lobes | of | mean | 95 % | largest |\n|---|---|---|---|---|")
    for form in FORMS:
        for name, found in shadow_cases.errors(form, options.lobes).items():
            values = 100 * np.array([found.mean(), np.quantile(found, 0.95), found.max()])
            print(f"| {form} | {name} | {values[0]:.1f} | {values[1]:.1f} | {values[2]:.0f} |")


if __name__ == "__main__":
    main()
