"""Inside Blender: an animation is baked, baked again, cancelled, and refused with a remedy.

usage: blender -b --factory-startup -noaudio --python bake.py -- ARCHIVE CONTROL OUT_JSON FOLDER
"""
import json
import pathlib
import sys

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from cloth_scene import argument, enable_addon, shaken_sheet


def refused(**settings):
    """What Bake says with these settings, which are taken back."""
    before = {name: getattr(scene.rustle, name) for name in settings}
    for name, value in settings.items():
        setattr(scene.rustle, name, value)
    try:
        bpy.ops.rustle.bake()
        return ""
    except RuntimeError as error:
        return str(error)
    finally:
        for name, value in before.items():
            setattr(scene.rustle, name, value)


enable_addon(argument(0))
from rustle_blender.bake import Bake
from rustle_blender.panel import hint

folder = pathlib.Path(argument(3))
scene = shaken_sheet(48)
scene.rustle.control = argument(1)
told = {"unsaved": refused()}
bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
told["sheet"] = refused(sheet=None)
told["daemon"] = refused(control=f"ipc://{folder}/nobody")
told["material"] = refused(material="lead")
told["folder"] = refused(output="//missing/sheet.wav")
told["hint"] = hint(scene)
told["ask"] = list(bpy.ops.rustle.ask())

scene.rustle.output = "//cancelled.wav"
scene.frame_set(7)
bake = Bake(scene)
for _ in range(10):
    bake.step()
cancelled = {"progress": bake.progress}
bake.cancel()
cancelled.update(frame=scene.frame_current, done=bake.done, strips=len(scene.sequence_editor.sequences) if scene.sequence_editor else 0,
                 file=(folder / "cancelled.wav").exists())

scene.rustle.output = "//baked.wav"
music = scene.sequence_editor_create().sequences.new_effect("music", "COLOR", 1, 1, frame_end=100)
results = [list(bpy.ops.rustle.bake()) for _ in range(2)]
strips = [{"name": strip.name, "channel": strip.channel, "start": strip.frame_start, "frames": strip.frame_duration,
           "path": bpy.path.abspath(strip.sound.filepath)} for strip in scene.sequence_editor.sequences if strip.type == "SOUND"]
pathlib.Path(argument(2)).write_text(json.dumps({"results": results, "strips": strips, "refused": told, "cancelled": cancelled,
                                                 "frame": scene.frame_current, "sounds": len(bpy.data.sounds)}))
