# SPDX-License-Identifier: Apache-2.0
"""Compiles the steps of the fit when asglight is installed or a wheel is built.

Without a C compiler nothing is lost but speed: the steps are those of torch then.
"""

import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLACE = Path("asglight", "fitting", "compiled")


class CompiledSteps(BuildHookInterface):
    """Puts the compiled library beside its sources, and into the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; say so where that fails.

        Args:
            version: "editable" or "standard".
            build_data: What goes into the wheel.
        """
        place = Path(self.root) / PLACE
        library = runpy.run_path(str(place / "library.py"))
        target = place / library["NAME"]
        failure = library["compile_library"](place, target)
        if failure is not None:
            self.app.display_warning(
                f"asglight: the steps of the fit are not compiled, {failure}; "
                "fits work and take about three times as long"
            )
        elif version != "editable":
            build_data["pure_python"] = False
            build_data["infer_tag"] = True
            build_data["force_include"][str(target)] = str(PLACE / library["NAME"])
