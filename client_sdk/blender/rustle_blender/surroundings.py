"""What surrounds the sheet: collision objects as obstacles, and the listener."""
import numpy as np

from .meshes import MeshReader


def collision_objects(scene, sheet):
    """Mesh objects with a collision modifier that is on, other than the sheet, by name."""
    return sorted((item for item in scene.objects
                   if item.type == "MESH" and item != sheet and not item.hide_viewport and item.collision is not None and item.collision.use),
                  key=lambda item: item.name)


class Obstacle:
    """A collision object: sent once as a mesh of its own space, then as poses, or as vertices where it deforms."""

    def __init__(self, obstacle_id, item):
        self.id, self.item = obstacle_id, item
        self.reader = MeshReader(item)
        self.matrix = self.vertices = None

    def changes(self, rustle, depsgraph):
        """(obstacle, pose, vertices), each None where it need not be sent. An obstacle whose mesh changes is sent anew."""
        evaluated = self.item.evaluated_get(depsgraph)
        matrix = np.array(evaluated.matrix_world, np.float64)
        local, triangles, rejoined = self.reader.local(depsgraph)
        moved = self.matrix is None or not np.array_equal(matrix, self.matrix)
        place, turn, scale = evaluated.matrix_world.decompose()
        vertices = np.ascontiguousarray(local * np.array(scale, np.float32))
        reshaped = rejoined or not np.array_equal(vertices, self.vertices)
        self.matrix, self.vertices = matrix, vertices
        pose = rustle.Pose(tuple(place), tuple(turn)) if moved or rejoined else None
        if rejoined:
            return rustle.Obstacle(self.id, rustle.Mesh(triangles, vertices), pose, self.item.name, self.item.rustle_surface), None, None
        return None, pose, vertices if reshaped else None


class Surroundings:
    """Obstacles and listener of a scene, as they were when it was made; sends what has changed since."""

    FLOOR = 1

    def __init__(self, scene, sheet, floor):
        self.obstacles = [Obstacle(self.FLOOR + 1 + k, item) for k, item in enumerate(collision_objects(scene, sheet))]
        self.floor = floor
        self.ear = None

    def send(self, rustle, session, depsgraph, time_s, listener):
        new, poses, vertices = [], {}, {}
        if self.floor:
            new.append(rustle.Obstacle(self.FLOOR, rustle.Plane(), name="floor", reflecting=True))
            self.floor = False
        for obstacle in self.obstacles:
            anew, pose, points = obstacle.changes(rustle, depsgraph)
            if anew is not None:
                new.append(anew)
            elif pose is not None:
                poses[obstacle.id] = pose
            if points is not None:
                vertices[obstacle.id] = points
        if new or poses or vertices:
            session.scene(time_s, obstacles=new, poses=poses, vertices=vertices)
        if listener is not None:
            matrix = np.array(listener.evaluated_get(depsgraph).matrix_world)
            if self.ear is None or not np.array_equal(matrix, self.ear):
                self.ear = matrix
                session.listener(time_s, matrix[:3, 3], forward=-matrix[:3, 2], up=matrix[:3, 1])
