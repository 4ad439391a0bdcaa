# SPDX-License-Identifier: Apache-2.0
"""Ways to run the command line."""

import subprocess
import sys
from pathlib import Path

RUN = "import sys\nfrom asglight.cli.main import main\n{hook}\nsys.exit(main(sys.argv[1:]))"


def run_asglight(*arguments: str | Path, hook: str = "") -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own, after a few lines of Python."""
    return subprocess.run(
        [sys.executable, "-c", RUN.format(hook=hook), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
    )
