"""An animation baked to a WAV file and a strip of the sequencer: on the simulation clock, so the same samples every time."""
import os
import pathlib
import time

import bpy

from .sdk import Problem, load, words
from .sender import Sender, frames_per_s

PATIENCE_S = 60.0  #: for the daemon to say something, once all was sent


def wav_path(scene):
    """The absolute path to write. Error: Problem."""
    chosen = scene.rustle.output
    if chosen.startswith("//") and not bpy.data.filepath:
        raise Problem("The WAV file's path is relative to the .blend file, which is not saved. Save it, or choose an absolute path.")
    path = pathlib.Path(os.path.realpath(bpy.path.abspath(chosen)))
    if path.suffix.lower() != ".wav":
        path = path.with_name(path.name + ".wav")
    if not path.parent.is_dir():
        raise Problem(f"The folder {path.parent} is not there. Make it, or choose another path for the WAV file.")
    return path


class Bake:
    """Step by step, so that Blender stays awake between the steps.

        bake = Bake(scene)
        while not bake.done: bake.step()
    """

    def __init__(self, scene):
        """Error: Problem; nothing has begun then."""
        self.scene = scene
        self.path = wav_path(scene)
        if scene.frame_end < scene.frame_start:
            raise Problem("The scene ends before it begins. Set its first and last frame.")
        self.sender = Sender(scene, load().Clock.SIMULATION)
        self.rustle = self.sender.rustle
        self.came_from = scene.frame_current
        self.next_frame, self.last_frame = scene.frame_start, scene.frame_end
        self.done, self.strip = False, None
        try:
            self.reader = self.sender.session.listen()
        except self.rustle.RustleError as error:
            self.sender.close(discard=True)
            raise Problem(words(error)) from None
        self.parts = self.reader.parts()
        self.heard_at = time.monotonic()

    @property
    def progress(self):
        """0 to 1."""
        return (self.next_frame - self.scene.frame_start) / (self.last_frame + 1 - self.scene.frame_start)

    def step(self):
        """A frame, or some of what is left of the sound. Error: Problem; the bake has ended then, and left nothing."""
        try:
            if self.next_frame <= self.last_frame:
                self._send_frame()
            else:
                self._hear(0.05)
        except Problem:
            self.cancel()
            raise
        except self.rustle.RustleError as error:
            self.cancel()
            raise Problem(words(error)) from None

    def cancel(self):
        """Nothing is written; the timeline is where it was."""
        self._leave(discard=True)

    def _send_frame(self):
        self.scene.frame_set(self.next_frame)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        self.sender.send(depsgraph, (self.next_frame - self.scene.frame_start) / frames_per_s(self.scene))
        self.next_frame += 1
        if self.next_frame > self.last_frame:
            self.sender.session.end()
        self._hear(0.0)
        self.heard_at = time.monotonic()

    def _hear(self, patience_s):
        while (block := self.reader.next(patience_s)) is not None:
            self.heard_at = time.monotonic()
            self.parts.take(block)
            if block.end:
                self._finish()
                return
        if time.monotonic() - self.heard_at > PATIENCE_S:
            raise Problem(f"The daemon said nothing for {PATIENCE_S:g} s. See its log, and bake again.")

    def _finish(self):
        try:
            self.parts.sound().write_wav(self.path)
        except OSError as error:
            raise Problem(f"{self.path} cannot be written: {error.strerror}. Choose another path for the WAV file.") from None
        self.strip = place_strip(self.scene, self.path, f"Rustle {self.sender.sheet.name}")
        self._leave(discard=False)

    def _leave(self, discard):
        if self.done:
            return
        self.done = True
        self.reader.close()
        self.sender.close(discard)
        self.scene.frame_set(self.came_from)


def place_strip(scene, path, name):
    """A sound strip at the scene's first frame, in the lowest channel that is free there; it takes the place of one of the same name."""
    editor = scene.sequence_editor_create()
    before = editor.sequences.get(name)
    channel = before.channel if before is not None else 0
    if before is not None:
        sound = before.sound
        editor.sequences.remove(before)
        if sound is not None and sound.users == 0:
            bpy.data.sounds.remove(sound)
    taken = {strip.channel for strip in editor.sequences_all if strip.frame_final_end > scene.frame_start}
    if channel in taken or channel == 0:
        channel = next(number for number in range(1, 129) if number not in taken)
    strip = editor.sequences.new_sound(name, str(path), channel, scene.frame_start)
    strip.name = name
    return strip
