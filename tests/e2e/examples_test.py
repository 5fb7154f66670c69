#!/usr/bin/python3
"""The examples of client_sdk/examples, run as a person runs them."""
import os
import re
import subprocess
import sys
import unittest

import numpy as np

from support import BIN, BUILD, SOURCE, RustleTest, bent, curvature_of, daemon, grid, main, read_wav, rms_dbfs
from support import rustle as run_rustle

EXAMPLES = SOURCE / "client_sdk/examples"


class Examples(RustleTest):
    def run_example(self, name, *arguments, status=0):
        """What it printed: standard output, or where it fails what it complains of."""
        environment = {**os.environ, "PYTHONPATH": str((BUILD / "python").resolve())}
        done = subprocess.run([sys.executable, EXAMPLES / name, *map(str, arguments)], cwd=self.folder, env=environment, capture_output=True,
                              text=True, timeout=300)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        return done.stderr if status else done.stdout

    def heard(self, name):
        rate, samples = read_wav(self.folder / name)
        self.assertGreater(rms_dbfs(samples), -60)
        return rate, samples.astype(np.float32)

    def test_mass_spring(self):
        with daemon(self.folder) as ends:
            said = self.run_example("mass_spring.py", "-o", "sheet.wav", "--control", ends["control"])
            frames, events, contacts = map(int, re.findall(r"\d+", said))
            self.assertEqual(frames, 240)
            self.assertGreater(events, 50)
            self.assertGreater(contacts, 0)
            rate, samples = self.heard("sheet.wav")
            for begin, end in ((0.5, 2.2), (2.8, 3.6)):  # shaken; let down and pulled
                self.assertGreater(rms_dbfs(samples[int(begin * rate):int(end * rate)]), -60)
            self.assertIn("60 frames", self.run_example("mass_spring.py", "--live", "--seconds", "1", "--control", ends["control"]))

    def write_obj(self, name, frames, faces, texture=None):
        """A folder of OBJ files, frames [F,V,3], faces with corners from 0."""
        folder = self.folder / name
        folder.mkdir()
        for k, positions in enumerate(frames):
            lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in positions]
            lines += [f"vt {u:.7f} {v:.7f}" for u, v in texture] if texture is not None else []
            corner = (lambda i: f"{i + 1}/{i + 1}") if texture is not None else (lambda i: str(i + 1))
            lines += ["f " + " ".join(corner(int(i)) for i in face) for face in faces]
            (folder / f"frame{k}.obj").write_text("\n".join(lines) + "\n")  # 9 before 10
        return folder

    def test_obj_sequence_sounds_as_its_capture(self):
        material, triangles = grid(0.2, 0.1, 16, 8)
        k = curvature_of(0.2, 0.1)
        frames = [bent(material, k * np.sin(2 * np.pi * 4 * t / 60)) + [0, 0, 0.3] for t in range(40)]
        folder = self.write_obj("frames", frames, triangles)
        capture = self.import_npz(folder, "--fps", "60")
        run_rustle("render", capture, "-o", self.folder / "rendered.wav")
        with daemon(self.folder) as ends:
            said = self.run_example("obj_sequence.py", folder, "-o", "played.wav", "--control", ends["control"])
        self.assertIn("40 files, 40 frames", said)
        np.testing.assert_array_equal(self.heard("played.wav")[1], self.heard("rendered.wav")[1])

    def test_obj_sequence_of_quads_in_centimetres_y_up_with_texture_over_a_table(self):
        columns, rows = 16, 8
        material, _ = grid(0.2, 0.1, columns, rows)
        corner = [row * (columns + 1) + column for row in range(rows) for column in range(columns)]
        quads = [(a, a + 1, a + columns + 2, a + columns + 1) for a in corner]
        frames = []
        for t in range(40):
            x, y, z = (bent(material, 3.0) + [0.004 * t, 0, 0.001]).T
            frames.append(100 * np.stack([x, z, -y], axis=1))
        folder = self.write_obj("frames", frames, quads, material / 0.2)
        with daemon(self.folder) as ends:
            said = self.run_example("obj_sequence.py", folder, "--scale", "0.01", "--up", "y", "--uv-size", "20", "--table", "--control", ends["control"])
        self.assertRegex(said, r"40 frames, \d+ crumpling events, [1-9]\d* contacts that slid")
        self.heard("obj_sequence.wav")

    def test_obj_sequence_whose_mesh_changes(self):
        coarse, fine = grid(0.2, 0.1, 16, 8), grid(0.2, 0.1, 20, 10)
        k = curvature_of(0.2, 0.1)
        folder = self.folder / "frames"
        for t in range(40):
            material, triangles = (coarse, fine)[t // 20]
            self.write_obj(f"one{t}", [bent(material, k * np.sin(2 * np.pi * 4 * t / 60))], triangles, material / 0.2)
        folder.mkdir()
        for t in range(40):
            (self.folder / f"one{t}/frame0.obj").rename(folder / f"{t}.obj")
        with daemon(self.folder) as ends:
            said = self.run_example("obj_sequence.py", folder, "--uv-size", "0.2", "--control", ends["control"])
        self.assertIn("40 frames", said)
        self.heard("obj_sequence.wav")

    def test_game_client(self):
        with daemon(self.folder) as ends:
            said = self.run_example("game_client.py", "-o", "walk.wav", "--control", ends["control"])
        frames, emitters, at_once, missing = (int(number) for number in re.findall(r"\d+", said))
        self.assertEqual(missing, 0)
        self.assertGreater(frames, 400)
        self.assertGreater(emitters, 10)
        self.assertGreater(at_once, 1)
        _, samples = self.heard("walk.wav")
        self.assertTrue((np.abs(samples).max(axis=0) > 1e-3).all())
        self.assertFalse(np.array_equal(samples[:, 0], samples[:, 1]))

    def run_program(self, name, *arguments, status=0):
        """As run_example(), of a compiled one."""
        done = subprocess.run([BIN / "examples" / name, *map(str, arguments)], cwd=self.folder, capture_output=True, text=True, timeout=300)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stderr if status else done.stdout

    def test_minimal_in_c(self):
        with daemon(self.folder) as ends:
            said = self.run_program("minimal", "minimal.wav", ends["control"])
        self.assertRegex(said, r"^120 frames, [1-9]\d* crumpling events, \d{5,} samples at 48000 Hz$")
        self.heard("minimal.wav")
        self.assertIn("nobody", self.run_program("minimal", "minimal.wav", f"ipc://{self.folder}/nobody", status=1))

    @unittest.skipUnless((BIN / "examples/bullet_soft_body").exists(), "built where Debian's libbullet-dev is installed")
    def test_bullet_soft_body(self):
        with daemon(self.folder) as ends:
            said = self.run_program("bullet_soft_body", "bullet.wav", ends["control"])
        frames, events, contacts = map(int, re.findall(r"\d+", said))
        self.assertEqual(frames, 210)
        self.assertGreater(events, 50)
        self.assertGreater(contacts, 0)
        rate, samples = self.heard("bullet.wav")
        for begin, end in ((0.3, 1.5), (2.2, 3.3)):  # shaken; drawn over the ball
            self.assertGreater(rms_dbfs(samples[int(begin * rate):int(end * rate)]), -60)

    def test_mistakes_are_named(self):
        nobody = f"ipc://{self.folder}/nobody"
        (self.folder / "empty").mkdir()
        (self.folder / "broken").mkdir()
        (self.folder / "broken/1.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n")
        for name in ("mass_spring.py", "game_client.py"):
            self.assertIn("nobody", self.run_example(name, "--control", nobody, status=1))
        self.assertIn("no *.obj", self.run_example("obj_sequence.py", "empty", "--control", nobody, status=1))
        with daemon(self.folder) as ends:
            said = self.run_example("obj_sequence.py", "broken", "--control", ends["control"], status=1)
        self.assertIn("1.obj, line 4: 'f 1 2 4'", said)


if __name__ == "__main__":
    main()
