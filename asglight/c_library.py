# SPDX-License-Identifier: Apache-2.0
"""The compiled libraries: where they are and how they are made.

It knows nothing else of asglight, for they are made before that can be imported (hatch_build.py):

    python asglight/c_library.py        # compiles them beside their sources
"""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

LIBRARIES = {"fitting/compiled": "steps.so", "images/compiled": "reduction.so"}
"""Of each folder of asglight/ that holds sources in C, the library that they make."""

X86 = ("x86_64", "AMD64")

FLAGS = (
    *("-std=c11", "-O3", "-shared", "-fPIC", "-fvisibility=hidden", "-pthread"),
    # no result depends on errno or on which of two floating point exceptions comes first
    *("-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"),
)

X86_FLAGS = {"steps.so": ("-march=x86-64-v3",)}
"""Of a library that is loaded only where the processor has AVX2 and FMA (Intel's since 2013, AMD's
since 2015); others ask the processor when they run, as do its products for AVX-512."""


def fingerprint(folder: Path) -> str:
    """Return what tells the sources in a folder from others, whose calls may differ."""
    sources = sorted(folder.glob("*.[ch]"))
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def compiler() -> str | None:
    """Return the command of the C compiler that CC names, or of one that is found."""
    return os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")


def compile_library(folder: Path, target: Path) -> str | None:
    """Compile the sources in a folder into one library.

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
        flags += X86_FLAGS.get(target.name, ())
    with tempfile.TemporaryDirectory(dir=target.parent) as beside:
        made = Path(beside) / target.name
        sources = sorted(map(str, folder.glob("*.c")))
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


def compile_all(package: Path) -> dict[Path, str | None]:
    """Compile every library beside its sources.

    Args:
        package: The folder asglight/.

    Returns:
        Of each library, why it could not be compiled; None if it was.
    """
    targets = [package / folder / name for folder, name in LIBRARIES.items()]
    return {target: compile_library(target.parent, target) for target in targets}


if __name__ == "__main__":
    for library, failure in compile_all(Path(__file__).parent).items():
        print(f"{library}: {failure or 'compiled'}")
