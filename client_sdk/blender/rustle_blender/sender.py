"""A sheet's frames on their way to the daemon: what live and baked sessions have in common."""
import collections

from . import meshes
from .sdk import Problem, load, words
from .surroundings import Surroundings

SHEET = 1


def chosen_sheet(scene):
    """Error: Problem."""
    sheet = scene.rustle.sheet
    if sheet is None:
        raise Problem("No sheet is chosen. Pick a mesh object in the Rustle panel.")
    if scene.objects.get(sheet.name) != sheet:
        raise Problem(f"The sheet {sheet.name} is not in this scene. Pick another in the Rustle panel.")
    return sheet


def frames_per_s(scene):
    return scene.render.fps / scene.render.fps_base


def options(rustle, scene, clock, origin_s=0.0):
    settings = scene.rustle
    unit = scene.unit_settings.scale_length if scene.unit_settings.system != "NONE" else 1.0
    sheet = rustle.SheetOptions(SHEET, name=settings.sheet.name, material=settings.material, touched_surface=settings.surface)
    return rustle.SessionOptions(name=settings.sheet.name.replace("/", "_"), clock=clock, time_origin_s=origin_s, metres_per_unit=unit * settings.scale,
                                 seed=settings.seed, channels=rustle.Channels(settings.channels), sheets=[sheet])


class Sender:
    """A connection, a session, and one sheet whose frames it sends."""

    def __init__(self, scene, clock):
        """Error: Problem."""
        self.rustle = load()
        self.sheet = chosen_sheet(scene)
        self.reader = meshes.MeshReader(self.sheet)
        self.topology_id, self.held = 0, None
        self.notices = collections.deque(maxlen=64)
        self.connection = self.session = None
        try:
            self.connection = self.rustle.Connection.connect(scene.rustle.control)
            self.session = self.rustle.Session.attach(self.connection, options(self.rustle, scene, clock), on_notice=self.notices.append)
        except self.rustle.RustleError as error:
            self.close()
            raise Problem(words(error)) from None
        self.surroundings = Surroundings(scene, self.sheet, scene.rustle.floor)
        self.listener = scene.rustle.listener or scene.camera

    def send(self, depsgraph, time_s, jumped=False):
        """One frame. Errors: Problem, RustleError."""
        positions, triangles, rejoined = self.reader.read(depsgraph, jumped)
        if not len(triangles):
            raise Problem(f"{self.sheet.name} has no faces. Pick a mesh with faces.")
        if rejoined:
            self.topology_id += 1
            flat, rest = meshes.rest_shape(self.sheet, len(positions))
            self.held = meshes.pinned(self.sheet, len(positions))
            self.session.add_topology(self.topology_id, triangles, len(positions), material_coordinates=flat, rest_positions=rest)
        self.surroundings.send(self.rustle, self.session, depsgraph, time_s, self.listener)
        return self.session.frame(SHEET, self.topology_id, time_s, positions, anchored=self.held, reset_history=jumped)

    def notice(self):
        """The newest warning or error of the daemon's; empty without one."""
        told = [notice for notice in self.notices if notice.level is not self.rustle.NoticeLevel.INFO]
        return str(told[-1]) if told else ""

    def close(self, discard=False):
        """What was sent is still rendered, unless discarded."""
        if self.session is not None:
            try:
                self.session.detach(discard)
            except self.rustle.RustleError:
                self.session.abandon()
            self.session = None
        if self.connection is not None:
            self.connection.close()
            self.connection = None
