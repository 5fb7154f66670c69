#!/usr/bin/python3
"""Recordings of the daemon: what a live session sounded like is rendered from them bit for bit; what they hold when the daemon is
killed, stopped, or its disk is full; who may write where."""
import contextlib
import json
import logging
import pathlib
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import zmq

from support import BIN, BUILD, RustleTest, bent, curvature_of, daemon, grid, main, read_wav, rms_dbfs, table
from support import rustle as run_rustle

sys.path.insert(0, str(BUILD / "python"))
import rustle
from rustle.v1 import session_pb2

logging.getLogger("rustle").setLevel(logging.CRITICAL)


def options(**more):
    return rustle.SessionOptions(**{"name": "flag", "clock": rustle.Clock.LIVE, "sheets": [rustle.SheetOptions(1, name="flag")], **more})


class Motion:
    """A sheet that is bent to and fro, three flaps a second, and slides over a table."""

    def __init__(self):
        self.material, self.triangles = grid(0.2, 0.1, 16, 8)
        self.curvature = curvature_of(0.2, 0.1)

    def at(self, t):
        shape = bent(self.material, self.curvature * np.sin(2 * np.pi * 3 * t))
        return (shape + [0.2 * np.sin(t), 0, 0.001]).astype(np.float32)

    def describe(self, session):
        arrays = table()
        session.scene(0, obstacles=[rustle.Obstacle(1, rustle.Mesh(arrays["obstacle0_triangles"], arrays["obstacle0_vertices"]))])
        session.add_topology(1, self.triangles, material_coordinates=self.material)

    def stream(self, session, seconds, jitter_s=0.0, withheld=0.0, bursts=(), seed=1, first_s=0.0, until=lambda: False):
        """60 frames a second in real time; each comes up to `jitter_s` late, some never; those from a burst's first second to its
        last come all at once."""
        chance, arriving = np.random.default_rng(seed), []
        for k in range(round(seconds * 60)):
            t = k / 60
            at = t + chance.uniform(0, jitter_s)
            for first, last in bursts:
                at = last if first <= t < last else at
            if chance.uniform() >= withheld:
                arriving.append((at, t))
        arriving.sort(key=lambda pair: (pair[0], pair[1]))
        start, newest = time.monotonic(), -1.0
        for at, t in arriving:
            time.sleep(max(0.0, start + at - time.monotonic()))
            if until():
                return
            if t > newest:
                session.frame(1, 1, first_s + t, self.at(first_s + t))
                newest = t


class Case(RustleTest):
    def setUp(self):
        super().setUp()
        self.recordings = self.folder / "recordings"
        self.motion = Motion()

    @contextlib.contextmanager
    def recording_daemon(self, *more):
        with daemon(self.folder, "--recordings", self.recordings, "--device", "none", *more) as ends:
            with rustle.Connection.connect(ends["control"]) as connection:
                yield ends, connection

    def rendered(self, file, *more, status=0):
        """(samples, figures) of a recording."""
        wav = self.folder / "rendered.wav"
        done = run_rustle("render", file, "-o", wav, "--json", *more, status=status)
        return read_wav(wav)[1].astype(np.float32), json.loads(done.stdout)

    def only_recording(self):
        files = list(self.recordings.iterdir())
        self.assertEqual(len(files), 1, files)
        return files[0]

    def heard_before(self, reader, seconds=0.5):
        """What has come to a reader: (first sample, samples)."""
        blocks = []
        with contextlib.suppress(rustle.RustleError):
            while (block := reader.next(seconds)) is not None and not block.end:
                self.assertEqual(block.missing_samples, 0)
                blocks.append(block)
        return blocks[0].first_sample, np.concatenate([block.samples for block in blocks])

    def assert_begins_alike(self, rendered, heard, first, at_least):
        """`heard` from sample `first` on is what `rendered` says, as far as both go."""
        common = min(len(rendered) - first, len(heard))
        self.assertGreater(common, at_least)
        np.testing.assert_array_equal(rendered[first:first + common], heard[:common])
        self.assertGreater(rms_dbfs(heard[:common]), -60)


class Exact(Case):
    def test_a_live_session_with_jitter_and_overload_is_rendered_bit_for_bit(self):
        with self.recording_daemon() as (ends, connection):
            reader = rustle.PcmReader.listen(connection, "flag")
            with reader, rustle.Session.attach(connection, options(record=True, seed=7)) as session:
                self.assertEqual((session.id, session.options.record), ("flag", True))
                name = session.recording_file_name
                self.motion.describe(session)
                self.motion.stream(session, 2, jitter_s=0.03, withheld=0.01, bursts=[(0.8, 1.2)])
                session.set_gains([rustle.Gain(-7, kind=rustle.SoundKind.FRICTION), rustle.Gain(2)])
                session.change_pack(1, "tracing-paper")
                # A daemon that gets no time, and then finds all that came meanwhile: more than it may lag behind.
                ends["process"].send_signal(signal.SIGSTOP)
                self.motion.stream(session, 0.35, first_s=2)
                ends["process"].send_signal(signal.SIGCONT)
                self.motion.stream(session, 2, jitter_s=0.03, withheld=0.01, bursts=[(0.5, 1.1)], first_s=2.35, seed=2)
                self.assertEqual(connection.list_sessions()[0].recording.file_name, name)
                statistics = session.detach()
                heard = reader.read_all()
            totals = connection.stop_recording("flag")  # has ended with the session
            self.assertEqual((totals.file_name, heard.first_sample, heard.gaps), (name, 0, ()))
        file = self.only_recording()
        self.assertEqual((file.name, file.stat().st_size), (name, totals.bytes))
        self.assertRegex(name, r"^flag_\d{8}T\d{6}Z\.mcap$")

        dropped = sum(statistics.frames_dropped.values())
        self.assertGreater(statistics.frames_dropped["backlog"], 5)
        self.assertEqual(statistics.frames_received, statistics.frames_analysed + dropped)
        self.assertGreater(statistics.input_gaps, 0)
        samples, figures = self.rendered(file)
        self.assertEqual(figures["frames"], statistics.frames_analysed)
        self.assertEqual(figures["frames_dropped"], statistics.frames_dropped)
        self.assertEqual(figures["left_out"], [])
        self.assertEqual(samples.shape, heard.samples.shape)
        np.testing.assert_array_equal(samples, heard.samples)
        self.assertGreater(rms_dbfs(samples), -50)
        again, _ = self.rendered(file, "--workers", 2, "--block-size", 1000)
        np.testing.assert_array_equal(again, samples)
        other, figures = self.rendered(file, "--ignore-decisions")
        self.assertEqual((figures["frames"], figures["frames_dropped"]), (statistics.frames_received, {}))
        common = min(len(other), len(samples))
        self.assertFalse(np.array_equal(other[:common], samples[:common]))

        wrong = run_rustle("render", file, "-o", self.folder / "x.wav", "--rate", 44100, status=2)
        self.assertIn("--ignore-decisions", wrong.stderr)
        shown = json.loads(run_rustle("inspect", file, "--film", 3, "--json").stdout)
        self.assertEqual(len(shown["frames"]), 3)
        with daemon(self.folder) as ends:
            wav = self.folder / "replayed.wav"
            done = run_rustle("replay", file, "--clock", "simulation", "--control", ends["control"], "--wav", wav, "--json")
        self.assertEqual(json.loads(done.stdout)["frames_analysed"], statistics.frames_received)
        np.testing.assert_array_equal(read_wav(wav)[1].astype(np.float32), other)

    def test_pauses_steps_and_binaural_sound_are_in_it_too(self):
        with self.recording_daemon("--hrtf", "structural") as (ends, connection):
            reader = rustle.PcmReader.listen(connection, "flag")
            wanted = options(record=True, channels=rustle.Channels.BINAURAL, block_size=256)
            with reader, rustle.Session.attach(connection, wanted) as session:
                self.motion.describe(session)
                self.motion.stream(session, 1.2, jitter_s=0.01)
                time.sleep(0.5)
                session.listener(9, (0.3, -0.5, 0.4))
                self.motion.stream(session, 1.2, jitter_s=0.01, first_s=9)
                statistics = session.detach()
                heard = reader.read_all()
        self.assertEqual(statistics.time_jumps, 1)
        samples, figures = self.rendered(self.only_recording())
        np.testing.assert_array_equal(samples, heard.samples)
        self.assertGreater(rms_dbfs(samples), -60)

    def test_a_simulation_is_what_any_capture_of_it_would_be(self):
        with self.recording_daemon() as (ends, connection):
            wanted = options(record=True, clock=rustle.Clock.SIMULATION)
            with rustle.Session.attach(connection, wanted) as session, session.listen() as reader:
                self.motion.describe(session)
                for k in range(90):
                    session.frame(1, 1, k / 60, self.motion.at(k / 60))
                session.end()
                heard = reader.read_all()
        file = self.only_recording()
        for more in ((), ("--ignore-decisions",)):
            samples, figures = self.rendered(file, *more)
            self.assertEqual(figures["frames"], 90)
            np.testing.assert_array_equal(samples, heard.samples)

    def test_a_publisher_without_control(self):
        endpoint = f"ipc://{self.folder}/publisher"
        context = zmq.Context()
        self.addCleanup(context.term)
        socket = context.socket(zmq.PUB)
        self.addCleanup(socket.close, 0)
        socket.bind(endpoint)
        described = [session_pb2.StreamMessage(sheet={"sheet_id": 1}), session_pb2.StreamMessage()]
        topology = described[1].topology
        topology.topology_id, topology.vertex_count = 1, len(self.motion.material)
        topology.triangles = self.motion.triangles.astype("<u4").tobytes()
        announcement = session_pb2.StreamMessage()
        announcement.announcement.protocol_version = 1
        announcement.announcement.options.record = True
        with self.recording_daemon("--connect", endpoint) as (ends, connection):
            reader = rustle.PcmReader.listen(connection, "bare")
            start = time.monotonic()
            for k in range(150):
                time.sleep(max(0.0, start + k / 60 - time.monotonic()))
                frame = session_pb2.StreamMessage()
                frame.frame.sheet_id, frame.frame.topology_id, frame.frame.time_s = 1, 1, k / 60
                frame.frame.positions = self.motion.at(k / 60).tobytes()
                # What describes the sheet comes before the announcement: it is kept, and is in the recording.
                for message in ([*described, announcement] if k % 60 == 10 else []) + [frame]:
                    socket.send_multipart([b"bare", message.SerializeToString()])
            statistics = connection.detach("bare")
            with reader:
                heard = reader.read_all()
        self.assertGreater(statistics.frames_dropped["unannounced"], 5)
        samples, figures = self.rendered(self.only_recording())
        self.assertEqual(figures["frames"], statistics.frames_analysed)
        np.testing.assert_array_equal(samples[heard.first_sample:], heard.samples)
        self.assertGreater(rms_dbfs(samples), -60)


class Ended(Case):
    def test_a_daemon_that_is_killed_leaves_everything_it_acknowledged(self):
        with self.recording_daemon() as (ends, connection):
            reader = rustle.PcmReader.listen(connection, "flag")
            session = rustle.Session.attach(connection, options(record=True), reconnect=False)
            self.motion.describe(session)
            before = session.next_sequence  # of the first frame
            self.motion.stream(session, 20, jitter_s=0.02, until=lambda: session.stored_sequence > 100)
            ends["process"].kill()
            stored = session.stored_sequence
            first, heard = self.heard_before(reader)
            reader.close()
        self.assertGreater(stored, 100)
        file = self.only_recording()
        samples, figures = self.rendered(file, status=1)
        self.assert_begins_alike(samples, heard, first, 48000)
        self.assertIn("cut", " ".join(figures["left_out"]))
        _, figures = self.rendered(file, "--ignore-decisions", status=1)
        self.assertGreaterEqual(figures["frames"], stored - before + 1)

    def test_a_daemon_that_is_stopped_closes_the_file(self):
        with self.recording_daemon() as (ends, connection):
            reader = rustle.PcmReader.listen(connection, "flag")
            session = rustle.Session.attach(connection, options(record=True), reconnect=False)
            self.motion.describe(session)
            self.motion.stream(session, 1.5)
            ends["process"].send_signal(signal.SIGTERM)
            self.assertEqual(ends["process"].wait(10), 0)
            first, heard = self.heard_before(reader)
            reader.close()
        samples, figures = self.rendered(self.only_recording())
        self.assert_begins_alike(samples, heard, first, 48000)
        self.assertGreaterEqual(len(samples) - first, len(heard))
        self.assertEqual(figures["left_out"], [])

    def test_a_full_disk_ends_the_recording_and_not_the_session(self):
        with self.recording_daemon() as (ends, connection):
            with rustle.Session.attach(connection, options(record=True), on_notice=lambda _: None) as session:
                reader = session.listen()
                name = session.recording_file_name
                self.motion.describe(session)
                resource.prlimit(ends["process"].pid, resource.RLIMIT_FSIZE, (150_000, 150_000))
                self.motion.stream(session, 10, until=lambda: not session.recording_file_name)
                notices = [notice for notice in session.poll_notices() if notice.code == "storage"]
                self.assertEqual(len(notices), 1, notices)
                self.assertIn(name, notices[0].message)
                self.assertTrue(notices[0].remedy)
                self.assertIsNone(connection.list_sessions()[0].recording)
                with self.assertRaises(rustle.Refused) as refused:
                    session.stop_recording()
                self.assertEqual(refused.exception.code_name, "storage")
                analysed = session.statistics().frames_analysed
                self.motion.stream(session, 0.5, first_s=20)
                self.assertGreater(session.statistics().frames_analysed, analysed + 20)
                newest = session.detach().samples_due
                sounds = reader.read_all()
                self.assertEqual(sounds.first_sample + len(sounds.samples), newest)
                self.assertGreater(rms_dbfs(sounds.samples[-24000:]), -60)
                stored = session.stored_sequence
                reader.close()
        _, figures = self.rendered(self.recordings / name, "--ignore-decisions", status=1)
        self.assertGreaterEqual(figures["frames"], stored - 2)
        self.assertGreater(stored, 20)

    def test_a_session_is_recorded_from_under_way_and_to_a_moment(self):
        with self.recording_daemon() as (ends, connection):
            with rustle.Session.attach(connection, options()) as session, session.listen() as reader:
                self.assertEqual(session.recording_file_name, "")
                self.motion.describe(session)
                self.motion.stream(session, 1)
                self.assertEqual(session.start_recording("take"), "take.mcap")
                with self.assertRaises(rustle.Refused) as refused:
                    session.start_recording("another")
                self.assertIn("take.mcap", str(refused.exception))
                self.motion.stream(session, 1.5, first_s=1)
                totals = session.stop_recording()
                self.motion.stream(session, 0.3, first_s=2.5)
                session.detach()
                heard = reader.read_all()
        self.assertEqual((totals.file_name, totals.bytes), ("take.mcap", self.only_recording().stat().st_size))
        samples, figures = self.rendered(self.only_recording())
        first = figures["first_sample"] - heard.first_sample
        self.assertGreater(first, 0.5 * 48000)
        self.assertGreater(len(samples), 1.2 * 48000)
        self.assertGreater(figures["frames"], 70)
        # What sounded before and the motion's history are missing; then it is the same scene.
        later = slice(24000, len(samples))
        self.assertLess(abs(rms_dbfs(samples[later]) - rms_dbfs(heard.samples[first:][later])), 3)
        self.assertEqual(samples.shape[1], 2)


class Names(Case):
    def refusal(self, session, name):
        with self.assertRaises(rustle.Refused) as refused:
            session.start_recording(name)
        self.assertTrue(refused.exception.remedy)
        return refused.exception.code_name

    def test_a_recording_stays_in_its_folder_and_overwrites_nothing(self):
        with self.recording_daemon() as (ends, connection), rustle.Session.attach(connection, options()) as session:
            outside = self.folder / "outside.mcap"
            (self.recordings / "link.mcap").symlink_to(outside)
            (self.recordings / "there.mcap").write_bytes(b"precious")
            for name in ("../outside", str(outside), "a/b", ".hidden", "..", "line\nbreak", "x" * 300, "link.mcap/"):
                self.assertEqual(self.refusal(session, name), "malformed" if len(name) < 256 else "too_large", name)
            for name in ("link", "there", "there.mcap"):
                self.assertEqual(self.refusal(session, name), "storage", name)
            self.assertFalse(outside.exists())
            self.assertEqual((self.recordings / "there.mcap").read_bytes(), b"precious")
            with self.assertRaises(rustle.Refused):
                session.stop_recording()
            self.assertEqual(session.start_recording("good name"), "good name.mcap")

    def test_names_of_sessions_make_good_file_names_each_its_own(self):
        with self.recording_daemon("--record-all") as (ends, connection):
            names = set()
            for k in range(3):
                with rustle.Session.attach(connection, options(name="Gr\u00fcn: 1*")) as session:
                    names.add(session.recording_file_name)
            for name in names:
                self.assertRegex(name, r"^Gr__n__1_(-\d)?_\d{8}T\d{6}Z(-\d)?\.mcap$")
        self.assertEqual({file.name for file in self.recordings.iterdir()}, names)
        self.assertEqual(len(names), 3)

    def test_a_daemon_without_a_folder_says_how_to_give_it_one(self):
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            with self.assertRaises(rustle.Refused) as refused:
                rustle.Session.attach(connection, options(record=True))
            self.assertIn("--recordings", refused.exception.remedy)
            with rustle.Session.attach(connection, options()) as session:
                self.assertEqual(self.refusal(session, "take"), "unsupported")
        started = [BIN / "rustled", "--control", f"ipc://{self.folder}/c", "--stream", "", "--out", f"ipc://{self.folder}/o"]
        for more in (["--record-all"], ["--recordings", "/proc/none"]):
            done = subprocess.run([*started, *more], capture_output=True, text=True, timeout=20)
            self.assertEqual(done.returncode, 1)
            self.assertIn("--recordings", done.stderr)


class Command(Case):
    def test_record_until_the_time_is_over(self):
        with self.recording_daemon() as (ends, connection), rustle.Session.attach(connection, options()) as session:
            self.motion.describe(session)
            self.motion.stream(session, 0.3)
            command = [BIN / "rustle", "record", "flag", "-o", "take", "--seconds", "1", "--json", "--control", ends["control"]]
            process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            self.motion.stream(session, 2, first_s=0.3)
            output, _ = process.communicate(timeout=20)
            self.assertEqual(process.returncode, 0)
            recorded = json.loads(output)["recordings"]
        self.assertEqual([(each["session"], each["file_name"]) for each in recorded], [("flag", "take.mcap")])
        samples, figures = self.rendered(self.recordings / "take.mcap")
        self.assertGreater(figures["frames"], 40)
        self.assertLess(len(samples), 2 * 48000)

    def test_record_every_session_until_interrupted(self):
        with self.recording_daemon() as (ends, connection):
            process = subprocess.Popen([BIN / "rustle", "record", "--all", "--json", "--control", ends["control"]],
                                       stdout=subprocess.PIPE, text=True)
            with rustle.Session.attach(connection, options(name="one")) as one:
                self.motion.describe(one)
                with rustle.Session.attach(connection, options(name="two")) as two:
                    self.motion.describe(two)
                    self.motion.stream(two, 0.7)
                self.motion.stream(one, 0.7)
                process.send_signal(signal.SIGINT)
                output, _ = process.communicate(timeout=20)
                self.assertIsNone(connection.list_sessions()[0].recording)
            self.assertEqual(process.returncode, 0)
            recorded = json.loads(output)["recordings"]
        self.assertEqual(sorted(each["session"] for each in recorded), ["one", "two"])
        for each in recorded:
            self.assertEqual((self.recordings / each["file_name"]).stat().st_size, each["bytes"])
            self.assertGreater(self.rendered(self.recordings / each["file_name"])[1]["frames"], 15)

    def test_record_the_next_session_until_it_ends(self):
        with self.recording_daemon() as (ends, connection), rustle.Session.attach(connection, options(name="before")):
            process = subprocess.Popen([BIN / "rustle", "record", "--next", "--control", ends["control"]],
                                       stdout=subprocess.PIPE, text=True)
            time.sleep(0.5)
            with rustle.Session.attach(connection, options()) as session:
                self.motion.describe(session)
                self.motion.stream(session, 0.6)
            output, _ = process.communicate(timeout=20)
            self.assertEqual(process.returncode, 0)
            self.assertIn("flag_", output)
        self.assertGreater(self.rendered(self.only_recording())[1]["frames"], 15)

    def test_mistakes(self):
        with self.recording_daemon() as (ends, connection):
            at = ["--control", ends["control"]]
            for arguments, said in ((["--next", "--all"], "leave one"), (["--all", "-o", "x"], "-o names one"), ([], "no session"),
                                    (["nobody"], "nobody")):
                self.assertIn(said, run_rustle("record", *arguments, *at, status=2).stderr)
            with rustle.Session.attach(connection, options()):
                self.assertIn("plain file name", run_rustle("record", "-o", "../x", *at, status=1).stderr)


if __name__ == "__main__":
    main()
