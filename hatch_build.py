"""The build of wheels and editable installs: compiles the C libraries into the package."""

from __future__ import annotations

import runpy
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_SCRIPT = Path(__file__).parent / "scripts" / "build_core.py"


class CoreBuildHook(BuildHookInterface):
    """Adds the compiled libraries, and the platform that they are for."""

    def dependencies(self) -> list[str]:
        """The wheel that brings a C compiler, if the system has none."""
        return [] if runpy.run_path(str(_SCRIPT))["system_compiler"]() else ["ziglang>=0.14"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile."""
        script = runpy.run_path(str(_SCRIPT))
        for name in script["SOURCES"]:
            library = script["build"](name=name)
            build_data["artifacts"].append(f"/src/bodysense/{library.name}")
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{platform}"
