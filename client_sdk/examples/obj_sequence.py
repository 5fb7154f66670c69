#!/usr/bin/env python3
"""Plays a folder of OBJ files, one a frame, through a running daemon.

usage: obj_sequence.py FOLDER [-o WAV] [--fps N] [--scale METRES] [--up z|y] [--table] [--live [--loop]] [--control ENDPOINT]

Files are taken in the order of the numbers in their names. Faces of any number of corners are split into triangles; texture
coordinates, where every vertex has one, become the flat sheet's material coordinates once --uv-size says how large it is. A mesh
that is made anew from frame to frame is sent as a new topology each time. `rustle import` makes a capture of the same files.
"""
import argparse
import pathlib
import re
import sys
import time

import numpy as np

import rustle


class Mesh:
    """One OBJ file. positions [V,3], triangles [T,3], material [V,2] or None; ValueError names file and line."""

    def __init__(self, path, uv_size_m=None):
        positions, texture, faces, texture_of = [], [], [], {}
        for number, line in enumerate(path.read_text().splitlines(), 1):
            words = line.split("#")[0].split()
            try:
                if words[:1] == ["v"]:
                    positions.append([float(word) for word in words[1:4]])
                elif words[:1] == ["vt"]:
                    texture.append([float(word) for word in words[1:3]])
                elif words[:1] == ["f"]:
                    corners = [corner.split("/") for corner in words[1:]]
                    face = [self.index(corner[0], len(positions)) for corner in corners]
                    for vertex, corner in zip(face, corners):
                        if len(corner) > 1 and corner[1]:
                            texture_of[vertex] = self.index(corner[1], len(texture))
                    faces += [(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)]
            except (ValueError, IndexError):
                raise ValueError(f"{path}, line {number}: {line.strip()!r} is no valid line of an OBJ file.") from None
        if not faces:
            raise ValueError(f"{path} has no faces.")
        self.positions = np.array(positions, np.float32)
        self.triangles = np.array(faces, np.uint32)
        self.material = None
        if uv_size_m and len(texture_of) == len(positions):
            flat = np.array([texture[texture_of[vertex]] for vertex in range(len(positions))])
            self.material = (flat * uv_size_m).astype(np.float32)

    @staticmethod
    def index(word, count):
        """From 1 on, or from -1 back."""
        value = int(word)
        index = value - 1 if value > 0 else count + value
        if value == 0 or not 0 <= index < count:
            raise ValueError
        return index


def in_order(folder):
    """The folder's OBJ files by the numbers in their names."""
    files = sorted(folder.glob("*.obj"), key=lambda path: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)])
    if not files:
        raise ValueError(f"{folder} has no *.obj files.")
    return files


class Player:
    """Sends meshes to a session; a topology when it is another than the frame's before."""

    def __init__(self, session):
        self.session, self.topology_id, self.triangles, self.vertices = session, 0, None, 0

    def show(self, mesh, time_s, jumped=False):
        same = self.vertices == len(mesh.positions) and np.array_equal(self.triangles, mesh.triangles)
        if not same:
            self.topology_id, self.triangles, self.vertices = self.topology_id + 1, mesh.triangles, len(mesh.positions)
            self.session.add_topology(self.topology_id, mesh.triangles, self.vertices, material_coordinates=mesh.material)
        self.session.frame(1, self.topology_id, time_s, mesh.positions, reset_history=jumped)


def play(session, files, arguments):
    if arguments.table:
        up = (0, 1, 0) if arguments.up == "y" else (0, 0, 1)
        session.scene(0.0, obstacles=[rustle.Obstacle(1, rustle.Plane(normal=up), reflecting=True)])
    player, start, frame = Player(session), time.monotonic(), 0
    while True:
        for place, path in enumerate(files):
            mesh = Mesh(path, arguments.uv_size)
            if arguments.live:
                time.sleep(max(0.0, start + frame / arguments.fps - time.monotonic()))
            player.show(mesh, frame / arguments.fps, jumped=frame > 0 and place == 0)
            frame += 1
        if not (arguments.live and arguments.loop):
            session.end()
            return


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="Example: obj_sequence.py frames/ --fps 60 --table -o sheet.wav")
    parser.add_argument("folder", type=pathlib.Path, help="of *.obj files")
    parser.add_argument("-o", "--output", default="obj_sequence.wav", help="WAV file for what is heard (%(default)s)")
    parser.add_argument("--fps", type=float, default=60.0, help="files a second (%(default)s)")
    parser.add_argument("--scale", type=float, default=1.0, help="metres of one unit of the files (%(default)s)")
    parser.add_argument("--up", choices=["z", "y"], default="z", help="the files' upward axis (%(default)s)")
    parser.add_argument("--uv-size", type=float, metavar="UNITS", help="length of 1 of the texture coordinates, in the files' units")
    parser.add_argument("--table", action="store_true", help="a wooden table lies at height 0")
    parser.add_argument("--material", default="", help="a sound pack's (printer-paper)")
    parser.add_argument("--live", action="store_true", help="at the pace of a clock, without a file")
    parser.add_argument("--loop", action="store_true", help="with --live: again and again, until Ctrl-C")
    parser.add_argument("--control", default=rustle.Endpoints().control, help="the daemon's control endpoint (%(default)s)")
    arguments = parser.parse_args()
    options = rustle.SessionOptions(
        name=arguments.folder.name, clock=rustle.Clock.LIVE if arguments.live else rustle.Clock.SIMULATION,
        metres_per_unit=arguments.scale, up_axis=rustle.UpAxis(arguments.up), sheets=[rustle.SheetOptions(1, material=arguments.material)])
    try:
        files = in_order(arguments.folder)
        with rustle.Connection.connect(arguments.control) as daemon, rustle.Session.attach(daemon, options) as session:
            if arguments.live:
                play(session, files, arguments)
            else:
                with session.listen() as reader:
                    play(session, files, arguments)
                    reader.read_all().write_wav(arguments.output)
            figures = session.detach()
    except KeyboardInterrupt:
        return 0
    except (rustle.RustleError, ValueError, OSError) as error:
        print(f"obj_sequence.py: {error}", file=sys.stderr)
        return 1
    print(f"{len(files)} files, {figures.frames_analysed} frames, {figures.crumpling_events} crumpling events, "
          f"{figures.friction_episodes} contacts that slid")
    return 0


if __name__ == "__main__":
    sys.exit(main())
