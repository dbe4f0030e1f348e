@tool
extends EditorPlugin
# The node BodysenseBody is registered by bodysense.gdextension; the plug-in has nothing to add to the editor.
