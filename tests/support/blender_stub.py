# SPDX-License-Identifier: Apache-2.0
"""The extension's files that need `bpy`, where there is none: what Blender does is left out."""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

PACKAGE = "integrations.blender"


class Thing(dict[str, Any]):
    """An object or a light of Blender: custom properties, and attributes as they are given."""

    def __init__(self, properties: dict[str, Any] | None = None, **attributes: Any) -> None:
        super().__init__(properties or {})
        self.__dict__.update(attributes)


class _Types(ModuleType):
    """Gives an empty class for every name."""

    def __getattr__(self, name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


class _Properties(ModuleType):
    """Gives a function that takes anything for every name."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda **_: None


@contextmanager
def extension(*names: str) -> Iterator[SimpleNamespace]:
    """Give modules of the extension by their names; afterwards they are gone."""
    kept = set(sys.modules)
    bpy = ModuleType("bpy")
    given = {
        "types": _Types("bpy.types"),
        "props": _Properties("bpy.props"),
        "data": SimpleNamespace(),
        "app": SimpleNamespace(background=False),
    }
    vars(bpy).update(given)
    stubs = {"bpy": bpy, "bpy.types": given["types"], "bpy.props": given["props"]}
    stubs |= {name: _Types(name) for name in ("bpy_extras", "bpy_extras.io_utils", "mathutils")}
    sys.modules.update(stubs)
    try:
        found = {name: importlib.import_module(f"{PACKAGE}.{name}") for name in names}
        yield SimpleNamespace(**found)
    finally:
        package = sys.modules[PACKAGE]
        for name in set(sys.modules) - kept:
            if name in stubs or (name.startswith(PACKAGE) and ".plain" not in name):
                del sys.modules[name]
                vars(package).pop(name.rpartition(".")[2], None)
