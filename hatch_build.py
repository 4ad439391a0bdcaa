# SPDX-License-Identifier: Apache-2.0
"""Compiles the libraries in C when asglight is installed or a wheel is built.

A wheel that was built with a compiler holds them, and is used without one.
Without a C compiler nothing is lost but speed: torch and numpy compute the same then.
"""

import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from packaging.tags import sys_tags

PACKAGE = Path("asglight")


def platform_tag() -> str:
    """Return the platform part of the wheel's name.

    The libraries are loaded with ctypes and know nothing of Python, so one wheel serves all its
    versions. The plain tag of a platform stands behind those of manylinux and musllinux, which a
    wheel may bear only after a check (`make release`).
    """
    platforms = (tag.platform for tag in sys_tags())
    return next(name for name in platforms if "linux" not in name or name.startswith("linux_"))


class CompiledLibraries(BuildHookInterface):
    """Puts the compiled libraries beside their sources, and into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; say so where that fails.

        Args:
            version: "editable" or "standard".
            build_data: What goes into the wheel.
        """
        root = Path(self.root)
        libraries = runpy.run_path(str(root / PACKAGE / "c_library.py"))
        for target, failure in libraries["compile_all"](root / PACKAGE).items():
            if failure is not None:
                self.app.display_warning(
                    f"asglight: {target.name} is not compiled, {failure}; all works, and fits "
                    "take about three times as long"
                )
            elif version != "editable":
                build_data["pure_python"] = False
                build_data["tag"] = f"py3-none-{platform_tag()}"
                build_data["force_include"][str(target)] = str(target.relative_to(root))
