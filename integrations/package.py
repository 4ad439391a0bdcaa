# SPDX-License-Identifier: Apache-2.0
"""Zip the Blender extension, as Blender installs it.

    python -m integrations.package -o dist

The same files give the same bytes, whenever and wherever. The extension has the version of
asglight, which is put into its manifest here.
"""

import argparse
import re
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parent / "blender"
MANIFEST = "blender_manifest.toml"
VERSION = Path(__file__).resolve().parents[1] / "asglight" / "__init__.py"
"""Where the version stands; read as text, for the zip is made without asglight installed."""

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
    text = manifest_text()
    manifest = tomllib.loads(text)
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
                    is_manifest = path.name == MANIFEST
                    package.writestr(entry, text if is_manifest else path.read_bytes())
        beside.replace(target)
    return target


def manifest_text() -> str:
    """Return the manifest with the version of asglight after the extension's name."""
    found = re.search(r'^__version__ = (".+")$', VERSION.read_text(), re.MULTILINE)
    assert found is not None
    text = (FOLDER / MANIFEST).read_text()
    return re.sub(r"^(id = .+)$", rf"\1\nversion = {found[1]}", text, count=1, flags=re.MULTILINE)


if __name__ == "__main__":
    sys.exit(main())
