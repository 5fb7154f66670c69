"""Rustle for Blender: a mesh object that moves is heard, live during playback or baked into the sequencer."""
from . import operators, panel, settings

bl_info = {
    "name": "Rustle",
    "description": "Gives deforming sheets their sound: live from a rustled, or baked as a sound strip",
    "blender": (3, 4, 0),
    "version": (0, 1, 0),
    "location": "3D View > Sidebar > Rustle",
    "category": "Animation",
}


def register():
    settings.register()
    operators.register()
    panel.register()


def unregister():
    panel.unregister()
    operators.unregister()
    settings.unregister()
