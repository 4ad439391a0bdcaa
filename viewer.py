#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Start the viewer from a checkout: `python viewer.py shot.usda`."""

import sys

if __name__ == "__main__":
    from asglight.viewer.app import main

    sys.exit(main())
