# SPDX-License-Identifier: Apache-2.0
"""The compiled library: where it is and how it is made.

It knows nothing else of asglight, for it is made before that can be imported (hatch_build.py).
"""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCES = (
    *("product.c", "lobes.c", "probes.c", "objective.c", "equations.c", "steps.c"),
    *("light.c", "minimise.c"),
)

NAME = "steps.so"

X86 = ("x86_64", "AMD64")

FLAGS = (
    *("-std=c11", "-O3", "-shared", "-fPIC", "-fvisibility=hidden"),
    # no result depends on errno or on which of two floating point exceptions comes first
    *("-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"),
)

MARCH = "-march=x86-64-v3"
"""AVX2 and FMA: Intel's processors since 2013, AMD's since 2015. With vectors of AVX-512 products
are no faster on processors that compute their halves one after the other."""


def fingerprint(folder: Path) -> str:
    """Return what tells the sources in a folder from others, whose calls may differ."""
    sources = sorted(folder.glob("*.[ch]"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def compiler() -> str | None:
    """Return the command of the C compiler that CC names, or of one that is found."""
    return os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")


def compile_library(folder: Path, target: Path) -> str | None:
    """Compile the sources in a folder.

    Args:
        folder: Where they are.
        target: The library to write; it is written beside it and renamed.

    Returns:
        Why it could not be compiled; None if it was.
    """
    command = compiler()
    if command is None or sys.platform == "win32":
        return "no C compiler was found (cc, gcc, or what CC names)"
    flags = [*FLAGS, f'-DSOURCES="{fingerprint(folder)}"']
    if platform.machine() in X86:
        flags.append(MARCH)
    with tempfile.TemporaryDirectory(dir=target.parent) as beside:
        made = Path(beside) / target.name
        sources = [str(folder / source) for source in SOURCES]
        whole = [*command.split(), *flags, "-o", str(made), *sources, "-lm"]
        try:
            done = subprocess.run(whole, capture_output=True, text=True, check=False)
        except OSError as error:
            return f"{command}: {error.strerror}"
        if done.returncode or not made.is_file():
            lines = done.stderr.strip().splitlines()
            return f"{command}: {lines[0] if lines else f'exit status {done.returncode}'}"
        made.replace(target)
    return None
