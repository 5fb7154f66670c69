#!/usr/bin/python3
"""What a person meets at the command line: help with examples, and errors that say what to do."""
import pathlib
import subprocess

import numpy as np

from support import BIN, STORED_CAPTURE, RustleTest, daemon, grid, main, rustle, save_npz

COMMANDS = ["demo", "render", "import", "inspect", "replay", "listen", "pack", "pack list", "pack check", "pack generate", "pack build", "pack show", "pack play"]


class Help(RustleTest):
    def test_every_command_has_help_with_an_example(self):
        for command in COMMANDS:
            with self.subTest(command):
                self.assertIn(f"Example: rustle {command.split()[0]}", rustle(*command.split(), "--help").stdout)
        done = subprocess.run([BIN / "rustled", "--help"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0)
        self.assertIn("Example: rustled", done.stdout)


class Words(RustleTest):
    def test_one_is_singular(self):
        material, triangles = grid(0.1, 0.1, 1, 1)
        flat = np.concatenate([material, 0 * material[:, :1]], 1)
        path = save_npz(self.folder / "one.npz", flat[None], triangles, [0.0])
        said = rustle("import", path, "-o", self.folder / "one.mcap").stdout
        self.assertIn("1 frame from", said)
        self.assertIn("1 topology, 2 triangles, 0 obstacles", said)
        self.assertIn("from 1 frame, 0 crumpling events, 0 friction episodes, 0 tears;",
                      rustle("render", self.folder / "one.mcap", "-o", self.folder / "one.wav").stdout)


class WrongUsage(RustleTest):
    def complaint(self, status, *arguments):
        text = rustle(*arguments, status=status).stderr
        self.assertNotIn("terminate", text)
        return text

    def test_no_or_unknown_command(self):
        self.complaint(2)
        self.complaint(2, "rnder")
        self.complaint(2, "render", STORED_CAPTURE)

    def test_unknown_material_names_those_there_are(self):
        text = self.complaint(2, "render", STORED_CAPTURE, "-o", self.folder / "x.wav", "--material", "parchment")
        self.assertIn("parchment", text)
        self.assertIn("printer-paper", text)

    def test_missing_files(self):
        self.assertIn("nowhere.mcap", self.complaint(2, "render", "nowhere.mcap", "-o", self.folder / "x.wav"))
        self.assertIn("/no/folder", self.complaint(1, "render", STORED_CAPTURE, "-o", "/no/folder/x.wav"))
        self.assertIn("nowhere.npz", self.complaint(1, "import", "nowhere.npz", "-o", self.folder / "x.mcap"))

    def test_not_a_capture(self):
        junk = self.folder / "junk.mcap"
        junk.write_bytes(b"not a capture at all, whatever its name")
        self.assertIn("junk.mcap", self.complaint(1, "render", junk, "-o", self.folder / "x.wav"))

    def test_a_cut_capture_gives_what_was_whole(self):
        cut = self.folder / "cut.mcap"
        whole = STORED_CAPTURE.read_bytes()
        for share in (0.5, 0.9):
            cut.write_bytes(whole[:int(len(whole) * share)])
            text = self.complaint(1, "render", cut, "-o", self.folder / "x.wav")
            self.assertIn("cut.mcap", text)
            self.assertGreater((self.folder / "x.wav").stat().st_size, 10000)

    def test_positions_that_are_no_numbers(self):
        material, triangles = grid(0.1, 0.1, 4, 4)
        flat = np.concatenate([material, 0 * material[:, :1]], 1)
        positions = np.repeat(flat[None], 5, 0)
        positions[3, 7, 1] = np.nan
        path = save_npz(self.folder / "nan.npz", positions, triangles, np.arange(5) / 60)
        text = self.complaint(1, "import", path, "-o", self.folder / "x.mcap")
        self.assertIn("frame 3", text)
        self.assertIn("vertex 7", text)
        self.assertFalse((self.folder / "x.mcap").exists())

    def test_index_out_of_range(self):
        material, triangles = grid(0.1, 0.1, 4, 4)
        triangles[5, 2] = 99
        flat = np.concatenate([material, 0 * material[:, :1]], 1)
        path = save_npz(self.folder / "index.npz", np.repeat(flat[None], 2, 0), triangles, np.arange(2) / 60)
        self.assertIn("99", self.complaint(1, "import", path, "-o", self.folder / "x.mcap"))

    def test_port_in_use(self):
        with daemon(self.folder) as ends:
            done = subprocess.run([BIN / "rustled", "--control", ends["control"], "--stream", ends["stream"] + "2", "--out", ends["out"] + "2"],
                                  capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 1)
            self.assertIn("--control", done.stderr)

    def test_open_binds_are_refused(self):
        done = subprocess.run([BIN / "rustled", "--control", "tcp://0.0.0.0:17399"], capture_output=True, text=True, timeout=20)
        self.assertEqual(done.returncode, 2)
        self.assertIn("bind tcp://127.0.0.1:17399", done.stderr)

    def test_no_daemon_there(self):
        text = self.complaint(1, "replay", STORED_CAPTURE, "--control", f"ipc://{self.folder}/nobody")
        self.assertIn("rustled", text)


class Inspect(RustleTest):
    def test_draws_a_frame(self):
        picture = self.folder / "frame.png"
        rustle("inspect", STORED_CAPTURE, "--time", 0.5, "-o", picture)
        self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")


class Render(RustleTest):
    def test_all_outputs(self):
        stems = self.folder / "stems"
        report, events = self.folder / "r.html", self.folder / "e.jsonl"
        done = rustle("render", STORED_CAPTURE, "-o", self.folder / "x.wav", "--format", "s24", "--channels", "mono", "--stems", stems,
                      "--report", report, "--events", events, "--json", "--mode", "published", "--gain-db", -6, "--rate", 44100)
        self.assertIn('"events"', done.stdout)
        self.assertTrue(list(stems.glob("*.wav")))
        page = report.read_text()
        self.assertIn("<html", page)
        self.assertNotIn("http://", page.replace("http://www.w3.org", ""))
        self.assertTrue(pathlib.Path(events).read_text())


if __name__ == "__main__":
    main()
