# SPDX-License-Identifier: Apache-2.0
"""Zip the Blender extension, as Blender installs it.

    python -m integrations.package -o dist

The same files give the same bytes, whenever and wherever.
"""

import argparse
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parent / "blender"

SUFFIXES = frozenset({".py", ".toml", ""})
"""Of what goes in; the one file without is the licence."""

EPOCH = (2020, 1, 1, 0, 0, 0)
"""The date of every file in it."""


def main(argv: Sequence[str] | None = None) -> int:
    """Write the zip and print where it is."""
    parser = argparse.ArgumentParser(prog="integrations.package", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("dist"), metavar="DIR")
    print(packed(parser.parse_args(argv).output))
    return 0


def packed(output: Path) -> Path:
    """Zip the extension.

    Args:
        output: Folder; the zip is named after the extension and its version.

    Returns:
        The zip.
    """
    manifest = tomllib.loads((FOLDER / "blender_manifest.toml").read_text())
    output.mkdir(parents=True, exist_ok=True)
    target = output / f"{manifest['id']}-blender-{manifest['version']}.zip"
    with tempfile.TemporaryDirectory(dir=output) as folder:
        beside = Path(folder) / target.name
        with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as package:
            for path in sorted(FOLDER.rglob("*")):
                if path.is_file() and path.suffix in SUFFIXES:
                    entry = zipfile.ZipInfo(path.relative_to(FOLDER).as_posix(), EPOCH)
                    entry.compress_type = zipfile.ZIP_DEFLATED
                    entry.external_attr = 0o644 << 16
                    package.writestr(entry, path.read_bytes())
        beside.replace(target)
    return target


if __name__ == "__main__":
    sys.exit(main())
