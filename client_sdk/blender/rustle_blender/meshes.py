"""Evaluated meshes as arrays. Shapes: V vertices, T triangles, in Blender units."""
import numpy as np

#: Modifiers that move vertices and leave faces as they are.
DEFORMING = {"ARMATURE", "CAST", "CLOTH", "COLLISION", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE",
             "MESH_CACHE", "MESH_DEFORM", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE_DEFORM", "WARP", "WAVE"}


class MeshReader:
    """One object's mesh after its modifiers, frame after frame, into arrays that are kept."""

    def __init__(self, item):
        self.item = item
        self._local = self._corners = self._faces = None
        self._triangles = np.zeros((0, 3), np.uint32)

    def read(self, depsgraph, jumped=False):
        """(positions [V,3] float32 in the world, triangles [T,3], whether these are others than the frame's before).

        jumped   this frame does not follow the one before: between them the mesh may have been edited
        """
        evaluated = self.item.evaluated_get(depsgraph)
        mesh = evaluated.data
        local = self._coordinates(mesh)
        changed = self._changed(mesh, jumped)
        matrix = np.array(evaluated.matrix_world, np.float32)
        positions = np.ascontiguousarray(local @ matrix[:3, :3].T + matrix[:3, 3])
        return positions, self._triangles, changed

    def local(self, depsgraph):
        """As read(), in the object's own space."""
        mesh = self.item.evaluated_get(depsgraph).data
        changed = self._changed(mesh, False)
        return self._coordinates(mesh).copy(), self._triangles, changed

    def _coordinates(self, mesh):
        count = len(mesh.vertices)
        if self._local is None or len(self._local) != count:
            self._local = np.empty((count, 3), np.float32)
        mesh.vertices.foreach_get("co", self._local.ravel())
        return self._local

    def _changed(self, mesh, jumped):
        """Where faces may be others, they are compared corner by corner: vertices may be joined otherwise at the same number."""
        same_counts = self._corners is not None and (len(mesh.loops), len(mesh.polygons)) == (len(self._corners), len(self._faces))
        if same_counts and not jumped and all(modifier.type in DEFORMING for modifier in self.item.modifiers):
            return False
        corners = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", corners)
        faces = np.empty(len(mesh.polygons), np.int32)
        mesh.polygons.foreach_get("loop_total", faces)
        if self._corners is not None and np.array_equal(corners, self._corners) and np.array_equal(faces, self._faces):
            return False
        self._corners, self._faces = corners, faces
        mesh.calc_loop_triangles()
        triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        self._triangles = triangles.reshape(-1, 3).astype(np.uint32)
        return True


def rest_shape(sheet, vertex_count):
    """(material coordinates [V,2] or None, rest positions [V,3] or None) of the object's own mesh, where no modifier changes the
    number of its vertices: flat meshes give the first, others the second."""
    if len(sheet.data.vertices) != vertex_count:
        return None, None
    rest = np.empty((vertex_count, 3), np.float32)
    sheet.data.vertices.foreach_get("co", rest.ravel())
    rest *= np.array(sheet.matrix_world.to_scale(), np.float32)
    centred = (rest - rest.mean(axis=0)).astype(float)
    _, extent, axes = np.linalg.svd(centred, full_matrices=False)
    if extent[2] < 1e-2 * extent[1]:
        return (centred @ axes[:2].T).astype(np.float32), None
    return None, rest


def pinned(sheet, vertex_count):
    """[V] bool: what the cloth's pin group holds; None without one."""
    names = [modifier.settings.vertex_group_mass for modifier in sheet.modifiers if modifier.type == "CLOTH"]
    group = next((sheet.vertex_groups[name] for name in names if name in sheet.vertex_groups), None)
    if group is None or len(sheet.data.vertices) != vertex_count:
        return None
    return np.array([any(entry.group == group.index and entry.weight >= 0.5 for entry in vertex.groups) for vertex in sheet.data.vertices])
