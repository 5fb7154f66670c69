#!/usr/bin/python3
"""What a person meets at the command line: help with examples, and errors that say what to do."""
import json
import os
import pathlib
import signal
import socket
import subprocess

import numpy as np

from support import BIN, STORED_CAPTURE, RustleTest, daemon, grid, main, rustle, save_npz

COMMANDS = ["demo", "render", "import", "inspect", "replay", "listen", "record", "pack", "pack list", "pack check", "pack generate", "pack build", "pack show", "pack play", "doctor"]


class Help(RustleTest):
    def test_every_command_has_help_with_an_example(self):
        for command in COMMANDS:
            with self.subTest(command):
                self.assertIn(f"Example: rustle {command.split()[0]}", rustle(*command.split(), "--help").stdout)
        done = subprocess.run([BIN / "rustled", "--help"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0)
        self.assertIn("Example: rustled", done.stdout)


class Doctor(RustleTest):
    def test_every_check_says_what_it_found_and_what_to_do(self):
        done = subprocess.run([BIN / "rustle", "doctor", "--json"], capture_output=True, text=True, env={**os.environ, "RUSTLED_CONFIG": str(self.config())})
        told = json.loads(done.stdout)
        names = {check["name"] for check in told["checks"]}
        self.assertEqual(names, {"configuration", "sound packs", "endpoints", "audio devices", "measured head", "processor", "scheduling",
                                 "real-time priority", "memory lock", "descriptors"})
        for check in told["checks"]:
            self.assertTrue(check["found"], check)
            self.assertEqual(check["remedy"] == "", check["grade"] == "granted", check)
        self.assertEqual(told["ready"], all(check["grade"] != "missing" for check in told["checks"]))
        self.assertEqual(done.returncode, 0 if told["ready"] else 1)

    def test_a_taken_port_and_a_wrong_file_are_missing(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            env = {**os.environ, "RUSTLED_CONFIG": str(self.config(f'control = "tcp://127.0.0.1:{taken.getsockname()[1]}"'))}
            done = subprocess.run([BIN / "rustle", "doctor"], capture_output=True, text=True, env=env)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stdout, r"endpoints\s+missing\s+tcp://127.0.0.1:\d+: Address already in use")
        env["RUSTLED_CONFIG"] = str(self.config("contrl = 3"))
        done = subprocess.run([BIN / "rustle", "doctor"], capture_output=True, text=True, env=env)
        self.assertEqual(done.returncode, 1)
        self.assertIn("did you mean network.control?", done.stdout)

    def config(self, more=""):
        path = self.folder / "rustled.toml"
        ends = "".join(f'{name} = "ipc://{self.folder}/{name}"\n' for name in ("control", "stream", "out") if f"{name} =" not in more)
        path.write_text(f"[network]\n{ends}{more}\n")
        return path


class Configuration(RustleTest):
    def rustled(self, *arguments, **environment):
        return subprocess.run([BIN / "rustled", *map(str, arguments)], capture_output=True, text=True, timeout=30,
                              env={**os.environ, "RUSTLED_CONFIG": "", **environment})

    def test_what_is_printed_is_read_again_unchanged(self):
        printed = self.rustled("--config", "none", "--print-config", "--max-sessions", 7, RUSTLED_AUDIO_BLOCK_SIZE="256")
        self.assertEqual(printed.returncode, 0, printed.stderr)
        self.assertIn("\nmost = 7\n", printed.stdout)
        self.assertIn("\nblock_size = 256\n", printed.stdout)
        path = self.folder / "rustled.toml"
        path.write_text(printed.stdout)
        self.assertEqual(self.rustled("--config", path, "--print-config").stdout, printed.stdout)

    def test_every_mistake_is_told_at_once(self):
        path = self.folder / "rustled.toml"
        path.write_text('[audio]\nrate = 47000\nblok_size = 64\n[network]\ncontrol = "udp://0.0.0.0:7390"\n')
        done = self.rustled("--config", path, "--max-sessions", "many")
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stdout, "")
        for wanted in (f"{path}:2: audio.rate: 47000 is not one of 44100, 48000, 96000", f"{path}:3: audio.blok_size is not known; did you mean audio.block_size?",
                       f"{path}:5: network.control udp://0.0.0.0:7390", "--max-sessions: sessions.most: many is not a whole number"):
            self.assertIn(wanted, done.stderr)

    def test_hangup_reads_the_file_again(self):
        path = self.folder / "rustled.toml"
        path.write_text("[sessions]\nmost = 3\n")
        with daemon(self.folder, "--config", path, "--device", "none") as ends:
            said = ends["process"].stderr

            def line_with(text):
                for line in said:
                    if text in line:
                        return line
                self.fail(f"rustled never said {text!r}")

            line_with("control ipc")
            path.write_text('[sessions]\nmost = 2\nanalysis_workers = 3\n')
            ends["process"].send_signal(signal.SIGHUP)
            line_with("sessions.analysis_workers takes effect when rustled starts again")
            line_with("sessions.most is taken over")
            path.write_text('[sessions]\nmost = 0\n')
            ends["process"].send_signal(signal.SIGHUP)
            line_with("sessions.most: 0 is not a whole number from 1 to 100000")
            line_with("all stays as it is")


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

    def test_output_that_cannot_be_written(self):
        with open("/dev/full", "w") as full:
            done = subprocess.run([BIN / "rustle", "pack", "list", "--json"], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("disk full", done.stderr)

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
        self.assertEqual(done.returncode, 1)
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
