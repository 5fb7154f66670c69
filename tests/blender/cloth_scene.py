"""Scenes for the add-on's tests, made inside Blender: a real cloth simulation of a sheet, and a fine mesh that a modifier moves."""
import math
import sys

import bpy
import numpy as np

LARGER = 10.0  # than life: Blender's cloth is made for clothes, so lengths and gravity are scaled alike
WIDTH_M, HEIGHT_M = 0.21, 0.297
FPS = 30


def enable_addon(archive):
    bpy.ops.preferences.addon_install(filepath=archive)
    bpy.ops.preferences.addon_enable(module="rustle_blender")


def argument(index):
    return sys.argv[sys.argv.index("--") + 1 + index]


def empty_scene(frames):
    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item, do_unlink=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = FPS, 1.0
    scene.frame_start, scene.frame_end = 1, frames
    scene.gravity = (0, 0, -9.81 * LARGER)
    return scene


def grid(scene, name, columns, rows, width, height):
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, columns + 1), np.linspace(-height / 2, height / 2, rows + 1))
    faces = [(a, a + 1, a + columns + 2, a + columns + 1)
             for row in range(rows) for column in range(columns) for a in [row * (columns + 1) + column]]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1).tolist(), [], faces)
    item = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(item)
    return item


def hand(scene, sheet, name, vertices, place):
    """An empty that holds vertices; place(t) is its way from where it began, in life-size metres."""
    empty = bpy.data.objects.new(name, None)
    scene.collection.objects.link(empty)
    at = np.mean([sheet.data.vertices[v].co for v in vertices], axis=0)
    for frame in range(scene.frame_start, scene.frame_end + 1):
        empty.location = at + LARGER * np.array(place((frame - scene.frame_start) / FPS))
        empty.keyframe_insert("location", frame=frame)
    empty.location = at
    bpy.context.view_layer.update()
    hook = sheet.modifiers.new(name, "HOOK")
    hook.object, hook.falloff_type = empty, "NONE"
    hook.vertex_indices_set(vertices)
    hook.matrix_inverse = empty.matrix_world.inverted()


def shaken_sheet(frames, columns=14, rows=20):
    """A sheet held by two corners: shaken for a second, then crushed between the hands, over a table."""
    scene = empty_scene(frames)
    table = grid(scene, "table", 4, 4, 8.0, 8.0)
    table.location.z = -0.6 * LARGER
    table.modifiers.new("collision", "COLLISION")
    table.rustle_surface = "wooden-table"
    sheet = grid(scene, "sheet", columns, rows, LARGER * WIDTH_M, LARGER * HEIGHT_M)
    for vertex in sheet.data.vertices:  # upright
        vertex.co = (vertex.co.x, 0.002 * LARGER * math.sin(9 * vertex.co.x), vertex.co.y)
    top = rows * (columns + 1)
    left, right = [top, top + 1], [top + columns - 1, top + columns]
    group = sheet.vertex_groups.new(name="hands")
    group.add(left + right, 1.0, "REPLACE")

    def way(side):
        def place(t):
            shake = 0.05 * math.sin(2 * math.pi * 4 * t + (side > 0)) if t < 1 else 0.0
            crush = side * 0.09 * min(1.0, max(0.0, (t - 1) / 0.6))
            return -crush, shake, 0.0
        return place

    hand(scene, sheet, "left", left, way(-1))
    hand(scene, sheet, "right", right, way(1))
    cloth = sheet.modifiers.new("cloth", "CLOTH")
    cloth.settings.quality = 6
    cloth.settings.mass = 0.3
    cloth.settings.tension_stiffness = cloth.settings.compression_stiffness = 300
    cloth.settings.shear_stiffness = 200
    cloth.settings.bending_model, cloth.settings.bending_stiffness = "ANGULAR", 30
    cloth.settings.vertex_group_mass = "hands"
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = scene.frame_start, scene.frame_end
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler = (0, -10, 0), (math.pi / 2, 0, 0)
    scene.camera = camera
    scene.rustle.sheet, scene.rustle.scale = sheet, 1 / LARGER
    return scene


def waving_grid(frames, vertices_a_side):
    """A mesh that a cheap modifier moves: what the hook costs is not hidden behind a simulation."""
    scene = empty_scene(frames)
    cells = vertices_a_side - 1
    sheet = grid(scene, "sheet", cells, cells, 2.0, 2.0)
    wave = sheet.modifiers.new("wave", "WAVE")
    wave.height, wave.width, wave.narrowness, wave.speed = 0.2, 1.0, 2.0, 0.1
    scene.rustle.sheet, scene.rustle.scale = sheet, 1 / LARGER
    return scene
