"""Preferences of the add-on: which bodysense is called."""

import shutil
from pathlib import Path

import bpy

from .process import launcher


class BodysensePreferences(bpy.types.AddonPreferences):
    """Program, and the source for uvx."""

    bl_idname = __package__

    path: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Program", description="bodysense; found on the PATH if empty", subtype="FILE_PATH"
    )
    source: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Source for uvx",
        description="Folder or address that `uvx --from` installs, used if bodysense is not on the PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the two fields."""
        self.layout.prop(self, "path")
        self.layout.prop(self, "source")


def start_words(context: bpy.types.Context) -> list[str]:
    """Return the words that start bodysense, by the preferences."""
    given = context.preferences.addons[__package__].preferences
    path = str(Path(bpy.path.abspath(given.path)).absolute()) if given.path else ""
    return launcher(path, shutil.which("bodysense"), shutil.which("uvx"), given.source)
