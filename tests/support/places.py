# SPDX-License-Identifier: Apache-2.0
"""Where things of the repository are, whichever folder a test stands in."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
"""The repository."""

SUPPORT = ROOT / "tests" / "support"
"""What tests share; some of it is run as a program."""

SHARED = ROOT.parent / "shared"
"""Maps and sequences beside the repository; not everybody has them."""
