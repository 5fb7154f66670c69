"""Inside Blender: a sheet is shaken and crumpled live, at the pace of a clock, and heard from the daemon meanwhile.

usage: blender -b --factory-startup -noaudio --python live.py -- ARCHIVE CONTROL OUT_JSON OUT_WAV
"""
import json
import pathlib
import statistics
import sys
import time

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from cloth_scene import FPS, argument, enable_addon, shaken_sheet, waving_grid


def play(scene):
    """Shows every frame when it is due."""
    begun = time.monotonic()
    for frame in range(scene.frame_start, scene.frame_end + 1):
        time.sleep(max(0.0, begun + (frame - scene.frame_start) / FPS - time.monotonic()))
        scene.frame_set(frame)


enable_addon(argument(0))
from rustle_blender import live

scene = shaken_sheet(60)
for frame in range(scene.frame_start, scene.frame_end + 1):  # fills the cloth's cache, as a first playback does
    scene.frame_set(frame)
scene.rustle.control = argument(1)
assert bpy.ops.rustle.start() == {"FINISHED"}
session = live.running.sender.session
reader = session.listen()
play(scene)
play(scene)  # the timeline goes back to its beginning
session.end()
sound = reader.read_all(60)
sound.write_wav(argument(3))
figures = session.statistics()
shown = live.running.frames
bpy.ops.rustle.stop()
assert live.running is None and live.trouble == "", live.trouble

processor_s = []
show = live.Live.show


def measured_show(self, *arguments):
    begun = time.thread_time()
    show(self, *arguments)
    processor_s.append(time.thread_time() - begun)


live.Live.show = measured_show
scene = waving_grid(200, 50)
scene.rustle.control = argument(1)
assert bpy.ops.rustle.start() == {"FINISHED"}
for frame in range(scene.frame_start, scene.frame_end + 1):
    scene.frame_set(frame)
cost_s, vertices = live.running.median_cost_s(), len(scene.rustle.sheet.data.vertices)
bpy.ops.rustle.stop()

scene.rustle.control = argument(1)
bpy.ops.rustle.start()
live.running.sender.session.abandon()  # as if it broke
scene.frame_set(2)
told = {"trouble": live.trouble, "still_running": live.running is not None}

pathlib.Path(argument(2)).write_text(json.dumps({
    "shown": shown, "frames_received": figures.frames_received, "frames_analysed": figures.frames_analysed, "refused": figures.messages_refused,
    "crumpling": figures.crumpling_events, "dropped": figures.frames_dropped, "hook_ms": 1000 * cost_s,
    "hook_processor_ms": 1000 * statistics.median(processor_s), "hook_vertices": vertices, **told}))
