#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""`asglight view` from a checkout, installed or not: `python viewer.py shot.usda`."""

import sys

if __name__ == "__main__":
    from asglight.cli.main import main

    sys.exit(main(["view", *sys.argv[1:]]))
