# SPDX-License-Identifier: Apache-2.0
"""`python -m asglight`: the command."""

import sys

from asglight.cli.main import main

sys.exit(main())
