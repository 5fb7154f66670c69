"""Streaming while the timeline plays: every frame that Blender shows is sent, and heard from the daemon."""
import collections
import statistics
import time

import bpy

from .sdk import Problem, load, words
from .sender import Sender, frames_per_s

JUMP_S = 0.25  #: a step of the timeline that is longer, or backwards, is no motion


class Live:
    """A session on the live clock, fed by the frame hook."""

    def __init__(self, scene):
        """Error: Problem."""
        self.scene = scene
        self.sender = Sender(scene, load().Clock.LIVE)
        self.frame, self.time_s = None, 0.0
        self.frames = 0
        self.costs_s = collections.deque(maxlen=1024)

    def show(self, scene, depsgraph):
        """After a frame of this scene was evaluated. Errors: Problem, RustleError."""
        if scene.name != self.scene.name or bpy.app.is_job_running("RENDER"):
            return
        begun = time.perf_counter()
        frame = scene.frame_current_final
        if frame == self.frame:
            return
        step_s = 0.0 if self.frame is None else (frame - self.frame) / frames_per_s(scene)
        jumped = self.frame is not None and not 0 < step_s <= JUMP_S
        self.time_s += 1 / frames_per_s(scene) if jumped else step_s
        self.frame = frame
        self.sender.send(depsgraph, self.time_s, jumped)
        self.frames += 1
        self.costs_s.append(time.perf_counter() - begun)

    def median_cost_s(self):
        """Of a frame's way through the hook; 0 before the first."""
        return statistics.median(self.costs_s) if self.costs_s else 0.0

    def close(self):
        self.sender.close()


running = None  #: the Live that the hook feeds
trouble = ""  #: why the last one ended


def start(scene):
    """Error: Problem."""
    global running, trouble
    stop()
    trouble = ""
    running = Live(scene)
    bpy.app.handlers.frame_change_post.append(_on_frame)
    bpy.app.handlers.load_pre.append(_on_load)


def stop():
    global running
    for handlers, hook in ((bpy.app.handlers.frame_change_post, _on_frame), (bpy.app.handlers.load_pre, _on_load)):
        if hook in handlers:
            handlers.remove(hook)
    if running is not None:
        running.close()
        running = None


def _on_frame(scene, depsgraph):
    global trouble
    try:
        running.show(scene, depsgraph)
    except Exception as error:  # a hook that raises would be called again and again
        if isinstance(error, Problem):
            trouble = str(error)
        elif isinstance(error, running.sender.rustle.RustleError):
            trouble = words(error)
        else:
            trouble = f"{type(error).__name__}: {error}. Start again; if it stays, report it."
        stop()


def _on_load(*_):
    stop()
