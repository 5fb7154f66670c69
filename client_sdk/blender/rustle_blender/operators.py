"""What the panel's buttons do."""
import time

import bpy

from . import live, settings
from .bake import Bake
from .sdk import Problem, load, words

STEP_S = 0.05  #: Blender draws and listens to keys so often while it bakes


class RUSTLE_OT_ask(bpy.types.Operator):
    """Ask the daemon which materials it has"""
    bl_idname, bl_label = "rustle.ask", "Ask Daemon"

    def execute(self, context):
        try:
            rustle = load()
            with rustle.Connection.connect(context.scene.rustle.control, 2.0) as daemon:
                settings.materials[:] = sorted({pack.material for pack in daemon.list_packs()})
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        except rustle.RustleError as error:
            self.report({"ERROR"}, words(error))
            return {"CANCELLED"}
        self.report({"INFO"}, "Materials: " + ", ".join(settings.materials))
        return {"FINISHED"}


class RUSTLE_OT_start(bpy.types.Operator):
    """Stream every frame that the timeline shows to the daemon, which makes it heard"""
    bl_idname, bl_label = "rustle.start", "Start Live"

    def execute(self, context):
        try:
            live.start(context.scene)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        return {"FINISHED"}


class RUSTLE_OT_stop(bpy.types.Operator):
    """End the live session"""
    bl_idname, bl_label = "rustle.stop", "Stop Live"

    def execute(self, context):
        live.stop()
        return {"FINISHED"}


class RUSTLE_OT_bake(bpy.types.Operator):
    """Play the animation through the daemon, write what it sounds like and put it into the sequencer. Esc cancels"""
    bl_idname, bl_label = "rustle.bake", "Bake to Strip"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """All at once, for scripts."""
        if not self._begin(context):
            return {"CANCELLED"}
        while not self.bake.done:
            if not self._step(context):
                return {"CANCELLED"}
        return self._end(context)

    def invoke(self, context, event):
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if not self._begin(context):
            return {"CANCELLED"}
        self.timer = context.window_manager.event_timer_add(STEP_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "ESC":
            self.bake.cancel()
            self._tidy(context)
            self.report({"INFO"}, "The bake was cancelled; nothing was written.")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        until = time.monotonic() + STEP_S
        while not self.bake.done and time.monotonic() < until:
            if not self._step(context):
                return {"CANCELLED"}
        return self._end(context) if self.bake.done else {"RUNNING_MODAL"}

    def _begin(self, context):
        live.stop()
        self.timer = None
        try:
            self.bake = Bake(context.scene)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return False
        context.window_manager.progress_begin(0, 100)
        return True

    def _step(self, context):
        try:
            self.bake.step()
        except Problem as problem:
            self._tidy(context)
            self.report({"ERROR"}, str(problem))
            return False
        percent = 100 * self.bake.progress
        context.window_manager.progress_update(percent)
        context.scene.rustle.progress = percent
        if context.workspace is not None:
            context.workspace.status_text_set(f"Rustle: baking, {percent:.0f} %. Esc cancels.")
        for area in context.screen.areas if context.screen is not None else ():
            if area.type == "VIEW_3D":
                area.tag_redraw()
        return True

    def _end(self, context):
        notice = self.bake.sender.notice()
        self._tidy(context)
        if notice:
            self.report({"WARNING"}, notice)
        self.report({"INFO"}, f"{self.bake.path} is in the sequencer.")
        return {"FINISHED"}

    def _tidy(self, context):
        context.window_manager.progress_end()
        context.scene.rustle.progress = 0
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        if self.timer is not None:
            context.window_manager.event_timer_remove(self.timer)


CLASSES = (RUSTLE_OT_ask, RUSTLE_OT_start, RUSTLE_OT_stop, RUSTLE_OT_bake)


def register():
    for kind in CLASSES:
        bpy.utils.register_class(kind)


def unregister():
    live.stop()
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
