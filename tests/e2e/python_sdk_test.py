#!/usr/bin/python3
"""The Python SDK: the same sound as any other sender, mistakes named before they are sent, daemons that go away and come back."""
import dataclasses
import gc
import logging
import math
import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

from support import BIN, BUILD, RustleTest, bent, curvature_of, daemon, grid, main, read_wav, rms_dbfs, save_npz, table
from support import rustle as run_rustle

sys.path.insert(0, str(BUILD / "python"))
import rustle
from rustle import messages
from rustle.standing import Standing
from rustle.v1 import audio_pb2, session_pb2, sheet_pb2

logging.getLogger("rustle").setLevel(logging.CRITICAL)

SIMULATION, LIVE = rustle.Clock.SIMULATION, rustle.Clock.LIVE


def options(clock=SIMULATION, **more):
    return rustle.SessionOptions(**{"name": "sheet", "clock": clock, "sheets": [rustle.SheetOptions(1)], **more})


class Motion:
    """A sheet that is bent to and fro, eight flaps a second, and slides over a table."""

    def __init__(self):
        self.material, self.triangles = grid(0.2, 0.1, 16, 8)
        self.curvature = curvature_of(0.2, 0.1)

    def at(self, t):
        shape = bent(self.material, self.curvature * np.sin(2 * np.pi * 4 * t))
        return (shape + [0.2 * t, 0, 0.001]).astype(np.float32)

    def send(self, session, times):
        for t in times:
            session.frame(1, 1, t, self.at(t))

    def play(self, session, seconds, scene=True):
        """Table, topology, frames and end."""
        if scene:
            arrays = table()
            mesh = rustle.Mesh(arrays["obstacle0_triangles"], arrays["obstacle0_vertices"])
            session.scene(0, obstacles=[rustle.Obstacle(1, mesh)])
        session.add_topology(1, self.triangles, material_coordinates=self.material)
        self.send(session, np.arange(round(seconds * 60)) / 60)
        session.end()


class Same(RustleTest):
    def test_python_and_cpp_give_the_same_samples(self):
        motion, times = Motion(), np.arange(60) / 60
        npz = save_npz(self.folder / "sheet.npz", [motion.at(t) for t in times], motion.triangles, times,
                       material_coordinates=motion.material, **table())
        capture = self.import_npz(npz, "--no-reflections")
        with daemon(self.folder) as ends:
            run_rustle("replay", capture, "--clock", "simulation", "--control", ends["control"], "--wav", self.folder / "cpp.wav")
            with rustle.Connection.connect(ends["control"]) as connection, rustle.Session.attach(connection, options()) as session:
                with session.listen() as reader:
                    motion.play(session, 1)
                    heard = reader.read_all()
                self.assertEqual(session.poll_notices(), [])
                statistics = session.detach()
        rate, expected = read_wav(self.folder / "cpp.wav")
        self.assertEqual((heard.rate_hz, heard.first_sample, heard.gaps), (rate, 0, ()))
        self.assertGreater(rms_dbfs(expected), -60)
        np.testing.assert_array_equal(heard.samples, expected.astype(np.float32))
        self.assertEqual((statistics.frames_received, statistics.frames_analysed, statistics.frames_dropped), (60, 60, {}))
        self.assertEqual(statistics.samples_due, statistics.samples_sent + statistics.samples_in_gaps)
        self.assertGreater(statistics.crumpling_events * statistics.friction_episodes, 0)

    def test_two_sessions_in_two_threads_do_not_mix(self):
        motion, heard = Motion(), {}

        def simulate(connection, name, amplitude):
            flat = motion.material * np.float32(amplitude)
            with rustle.Session.attach(connection, options(name=name)) as session, session.listen() as reader:
                session.add_topology(1, motion.triangles, material_coordinates=flat)
                for t in np.arange(45) / 60:
                    session.frame(1, 1, t, (motion.at(t) * amplitude).astype(np.float32))
                session.end()
                heard[name] = reader.read_all().samples

        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            both = [threading.Thread(target=simulate, args=(connection, name, size)) for name, size in (("a", 1.0), ("b", 2.0))]
            for thread in both:
                thread.start()
            for thread in both:
                thread.join(60)
            simulate(connection, "alone", 1.0)
            self.assertEqual(connection.list_sessions(), [])
        np.testing.assert_array_equal(heard["a"], heard["alone"])
        self.assertGreater(np.abs(heard["a"]).max(), 1e-4)
        self.assertFalse(np.array_equal(heard["a"], heard["b"]))

    def test_one_thread_interleaves_two_sessions(self):
        motion = Motion()
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            with rustle.Session.attach(connection, options(name="x")) as x, rustle.Session.attach(connection, options(name="x")) as y:
                self.assertNotEqual(x.id, y.id)
                self.assertEqual({known.session_id for known in connection.list_sessions()}, {x.id, y.id})
                readers = [x.listen(), y.listen()]
                for session in (x, y):
                    session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                for t in np.arange(30) / 60:
                    for session in (x, y):
                        session.frame(1, 1, t, motion.at(t))
                x.end(), y.end()
                first, second = (reader.read_all().samples for reader in readers)
        np.testing.assert_array_equal(first, second)

    def test_the_demo_writes_a_sound_file(self):
        wav, environment = self.folder / "bend.wav", {**os.environ, "PYTHONPATH": str(BUILD / "python")}
        with daemon(self.folder) as ends:
            command = [sys.executable, "-m", "rustle.demo", "-o", wav, "--seconds", "1", "--control", ends["control"]]
            subprocess.run(command, check=True, env=environment, capture_output=True, timeout=60)
        self.assertGreater(np.abs(read_wav(wav)[1]).max(), 1e-3)
        command[-1] = f"ipc://{self.folder}/nobody"
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 1)
        self.assertIn("nobody", done.stderr)
        self.assertNotIn("Traceback", done.stderr)

    def test_statistics_have_every_figure_of_the_wire(self):
        self.assertEqual({field.name for field in dataclasses.fields(rustle.Statistics)}, set(session_pb2.Statistics.DESCRIPTOR.fields_by_name))

    def test_options_come_back_as_they_were_sent(self):
        asked = options(LIVE, time_origin_s=1.5, metres_per_unit=0.01, up_axis=rustle.UpAxis.Y, seed=2**63, mode=rustle.SynthesisMode.PUBLISHED,
                        playout_delay_s=0.1, rate_hz=44100, block_size=64, channels=rustle.Channels.BINAURAL, default_material="cloth",
                        record=True, hrtf="kemar", friction_fft_size=512, most_voices=64)
        sent = session_pb2.SessionOptions()
        messages.write_options(asked, sent)
        self.assertEqual({field.name for field, _ in sent.ListFields()} | {"cloth_features"}, set(sent.DESCRIPTOR.fields_by_name))
        self.assertEqual(messages.read_options(sent, options()), asked)

    def test_everything_a_stream_can_say_is_taken(self):
        motion = Motion()
        vertices, cells = len(motion.material), len(motion.triangles)
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            with rustle.Session.attach(connection, options(sheets=[]), on_notice=rustle.raise_notice) as session:
                observations = session.observe()
                session.add_sheet(rustle.SheetOptions(1, name="page", material="printer-paper", grammage_kg_per_m2=0.08))
                session.add_topology(1, motion.triangles, material_coordinates=motion.material, rest_positions=motion.at(0))
                box = motion.at(0) * np.float32(0.1) - np.float32([0, 0, 1])
                shapes = [rustle.Plane((0, 0, -1)), rustle.Box((1, 1, 0.1)), rustle.Sphere(0.1), rustle.Capsule(0.1, 0.2),
                          rustle.Mesh(motion.triangles, box)]
                session.scene(0, obstacles=[rustle.Obstacle(k, shape, rustle.Pose((0, 0, -2))) for k, shape in enumerate(shapes)])
                session.listener(0, (0, -1, 1), forward=(0, 1, -1), up=(0, 0, 1))
                touching = rustle.Contacts(np.arange(4), np.zeros(4, int), [rustle.ContactPartner(1)],
                                           np.full((4, 3), 0.1, np.float32), np.ones(4, np.float32))
                parts = rustle.Partition(np.zeros(cells, int), np.array([True]), np.zeros((1, 6), np.float32), np.zeros(1, int),
                                         np.zeros((0, 3), np.float32))
                tip = rustle.TearTip(1, (0, 0, 0), 0.1, (1, 0, 0))
                for k, t in enumerate(np.arange(60) / 60):
                    session.frame(1, 1, t, motion.at(t), velocities=np.zeros((vertices, 3), np.float32),
                                  anchored=np.zeros(vertices, bool), reset_history=k == 30,
                                  contacts=touching if k % 2 else rustle.Contacts(), partition=parts if k > 50 else None,
                                  tear_tips=[tip] if k == 40 else ())
                    session.scene(t, poses={2: rustle.Pose((0, 0, -2 - t), (1, 0, 0, 0))}, vertices={4: box})
                session.scene(1, removed=[3])
                session.tear_tips(1, 1, [tip])
                session.advance(1.5)
                session.end(2.0)
                session.drain()
                self.assertEqual(session.statistics().frames_analysed, 60)
                self.assertEqual(session.acknowledged_sequence, session.next_sequence - 1)
                self.assertIsNotNone(observations.next(5))


class Arguments(RustleTest):
    def setUp(self):
        super().setUp()
        ends = self.enterContext(daemon(self.folder))
        self.connection = self.enterContext(rustle.Connection.connect(ends["control"]))
        self.motion = Motion()
        self.session = self.enterContext(rustle.Session.attach(self.connection, options()))
        self.session.add_topology(1, self.motion.triangles, material_coordinates=self.motion.material)

    def refused(self, field, text, call, *arguments, **named):
        sent = self.session.sent_messages
        with self.assertRaises(rustle.InvalidArgument) as caught:
            call(*arguments, **named)
        self.assertEqual(self.session.sent_messages, sent)
        error = caught.exception
        self.assertEqual((error.field, error.code_name, error.code), (field, "invalid", 0))
        self.assertIn(text, error.message)
        self.assertTrue(error.remedy.endswith("."), error.remedy)
        self.assertIsInstance(error, ValueError)

    def test_positions(self):
        good = self.motion.at(0)
        frame = lambda positions, **more: self.session.frame(1, 1, 0.0, positions, **more)
        broken = good.copy()
        broken[5, 1] = np.nan
        self.refused("frame.positions", "float64", frame, good.astype(float))
        self.refused("frame.positions", ">f4", frame, good.astype(">f4"))
        self.refused("frame.positions", "not contiguous", frame, np.asfortranarray(good))
        self.refused("frame.positions", "not contiguous", frame, np.repeat(good, 2, 0)[::2])
        self.refused("frame.positions", "[153,2]", frame, good[:, :2].copy())
        self.refused("frame.positions", "[152,3]", frame, good[:-1])
        self.refused("frame.positions", "[459]", frame, good.ravel())
        self.refused("frame.positions", "[5, 1] is nan", frame, broken)
        self.refused("frame.positions", "list", frame, good.tolist())
        self.refused("frame.velocities", "float64", frame, good, velocities=good.astype(float))
        self.refused("frame.anchored", "float32", frame, good, anchored=np.zeros(len(good), np.float32))
        self.refused("frame.anchored", "[7]", frame, good, anchored=np.zeros(7, bool))
        self.refused("frame.topology_id", "was not added", self.session.frame, 1, 2, 0.0, good)
        self.refused("frame.time_s", "nan", self.session.frame, 1, 1, float("nan"), good)
        self.refused("frame.sheet_id", "-1", self.session.frame, -1, 1, 0.0, good)
        frame(good)
        self.session.drain()
        self.assertEqual(self.session.statistics().messages_received, 2)

    def test_topologies(self):
        cells, flat = self.motion.triangles, self.motion.material
        add = lambda *arguments, **named: self.session.add_topology(2, *arguments, **named)
        wrong = cells.copy()
        wrong[3, 1] = len(flat)
        self.refused("topology.triangles", f"Entry [3, 1] is {len(flat)}; there are {len(flat)} vertices", add, wrong, len(flat))
        wrong[3, 1] = -1
        self.refused("topology.triangles", "Entry [3, 1] is -1", add, wrong)
        self.refused("topology.triangles", "float64", add, cells.astype(float))
        self.refused("topology.triangles", "[T,3]", add, cells[:, :2])
        self.refused("topology.material_coordinates", f"[{len(flat)},2]", add, cells, len(flat), material_coordinates=self.motion.at(0))
        self.refused("topology.rest_positions", "float64", add, cells, rest_positions=self.motion.at(0).astype(float))
        self.refused("frame.topology_id", "was not added", self.session.frame, 1, 2, 0.0, self.motion.at(0))
        add(cells.astype(np.int64).tolist())

    def test_extras_and_scenes(self):
        good, vertices = self.motion.at(0), len(self.motion.material)
        frame = lambda **more: self.session.frame(1, 1, 0.0, good, **more)
        table_of_one = [rustle.ContactPartner(1)]
        self.refused("frame.contacts.vertices", f"is {vertices};", frame, contacts=rustle.Contacts(np.array([vertices]), np.array([0]), table_of_one))
        self.refused("frame.contacts.partners", "is 1; there are 1", frame, contacts=rustle.Contacts(np.array([0]), np.array([1]), table_of_one))
        self.refused("frame.contacts.partners", "[2]", frame, contacts=rustle.Contacts(np.array([0]), np.array([0, 0]), table_of_one))
        self.refused("frame.contacts.slip_velocities", "[1,2]", frame,
                     contacts=rustle.Contacts(np.array([0]), np.array([0]), table_of_one, np.zeros((1, 2), np.float32)))
        self.refused("frame.tear_tips[0].position", "2 numbers", frame, tear_tips=[rustle.TearTip(1, (0, 0))])
        scene = lambda shape, **more: self.session.scene(0, obstacles=[rustle.Obstacle(1, shape, **more)])
        self.refused("scene.obstacles[0].plane.normal[2]", "inf", scene, rustle.Plane(normal=(0, 0, float("inf"))))
        self.refused("scene.obstacles[0].mesh.triangles", "is 9;", scene, rustle.Mesh(np.array([[0, 1, 9]]), np.zeros((3, 3), np.float32)))
        self.refused("scene.obstacles[0].shape", "str", scene, "sphere")
        self.refused("scene.obstacles[0].pose.orientation", "3 numbers", scene, rustle.Sphere(1), pose=rustle.Pose(orientation=(0, 0, 1)))
        self.refused("listener.position", "None", self.session.listener, 0, None)
        self.refused("blocks", "5", self.session.listen, rustle.ListenOptions(blocks=5))

    def test_what_the_daemon_refuses(self):
        flat = self.motion.material
        self.session.frame(1, 1, 0.5, self.motion.at(0))
        self.session.frame(1, 1, 0.4, self.motion.at(0))
        self.session.drain()
        notices = []
        deadline = time.monotonic() + 10
        while not notices and time.monotonic() < deadline:
            notices = self.session.poll_notices()
        self.assertEqual((notices[0].code, notices[0].field, notices[0].sequence), ("time_order", "frame.time_s", 3))
        self.assertTrue(notices[0].message and notices[0].remedy)

        with self.assertRaises(rustle.Refused) as caught:
            rustle.Session.attach(self.connection, options(default_material="lead"))
        self.assertEqual((caught.exception.code_name, caught.exception.code), ("unknown_material", session_pb2.ERROR_CODE_UNKNOWN_MATERIAL))
        self.assertIn("lead", str(caught.exception))
        with self.assertRaises(rustle.SessionLost):
            self.connection.statistics("nobody")

        with self.assertRaises(rustle.Refused) as caught:
            with rustle.Session.attach(self.connection, options(), on_notice=rustle.raise_notice) as strict:
                strict.add_topology(1, self.motion.triangles, material_coordinates=flat)
                for t in (0.5, 0.4, *np.arange(1, 1000)):
                    strict.frame(1, 1, t, self.motion.at(0))
                    time.sleep(0.01)
        self.assertEqual((caught.exception.code_name, caught.exception.field), ("time_order", "frame.time_s"))
        self.assertEqual([known.session_id for known in self.connection.list_sessions()], [self.session.id])


class Sessions(RustleTest):
    def test_a_context_detaches_on_an_exception_and_a_lost_one_by_itself(self):
        motion = Motion()
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            with self.assertRaises(ZeroDivisionError):
                with rustle.Session.attach(connection, options()) as session:
                    session.add_topology(1, motion.triangles)
                    session.frame(1, 1, 0.0, motion.at(0))
                    1 / 0
            self.assertEqual(connection.list_sessions(), [])
            with self.assertRaises(rustle.Closed):
                session.frame(1, 1, 0.1, motion.at(0.1))
            session = rustle.Session.attach(connection, options())
            self.assertEqual(len(connection.list_sessions()), 1)
            del session
            gc.collect()
            deadline = time.monotonic() + 10
            while connection.list_sessions() and time.monotonic() < deadline:
                time.sleep(0.05)
            self.assertEqual(connection.list_sessions(), [])

    def test_what_is_collected_in_a_cycle_waits_for_nothing(self):
        program = ("import gc, sys, rustle; connection = rustle.Connection.connect(sys.argv[1]); session = rustle.Session.attach(connection); "
                   "session.itself = session; connection.close(); del session, connection; gc.collect()")
        with daemon(self.folder) as ends:
            subprocess.run([sys.executable, "-c", program, ends["control"]], check=True, timeout=60,
                           env={**os.environ, "PYTHONPATH": str((BUILD / "python").resolve())})

    def test_a_session_that_others_end_is_lost_and_an_idle_one_begins_again(self):
        motion = Motion()
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            for idle in (False, True):
                with rustle.Session.attach(connection, options(LIVE)) as session:
                    def go_on(until):
                        deadline = time.monotonic() + 15
                        while not until():
                            self.assertLess(time.monotonic(), deadline)
                            session.frame(1, 1, time.monotonic(), motion.at(0))
                            time.sleep(0.01)

                    session.add_topology(1, motion.triangles)
                    session.frame(1, 1, 0.0, motion.at(0))
                    connection.detach(session.id)
                    if idle:  # as the daemon says after 300 s without a message
                        notice = audio_pb2.Notice(level=audio_pb2.NOTICE_LEVEL_ERROR, code="idle")
                        session._take([b"notices", audio_pb2.OutMessage(notice=notice).SerializeToString()])
                        go_on(lambda: session.reattached == 1 and session.connected)
                        go_on(lambda: session.statistics().frames_analysed > 0)
                    else:
                        with self.assertRaises(rustle.SessionLost):
                            go_on(lambda: False)

    def test_a_simulation_waits_for_credit_and_live_never_does(self):
        motion = Motion()
        with daemon(self.folder) as ends, rustle.Connection.connect(ends["control"]) as connection:
            with rustle.Session.attach(connection, options(), reconnect=False) as session:
                session.add_topology(1, motion.triangles)
                motion.send(session, np.arange(5) / 60)
                session.drain()
                ends["process"].send_signal(signal.SIGSTOP)
                try:
                    session.send_timeout_s = 0.3  # less than it takes to notice
                    with self.assertRaises((rustle.TimedOut, rustle.Unreachable)) as caught:
                        motion.send(session, 1 + np.arange(1000) / 60)
                    self.assertIn(ends["control"], str(caught.exception))
                    self.assertLessEqual(session.sent_messages, 6 + 64)
                finally:
                    ends["process"].send_signal(signal.SIGCONT)
            for reconnect in (True, False):
                with rustle.Session.attach(connection, options(LIVE), reconnect=reconnect) as session:
                    session.add_topology(1, motion.triangles)
                    ends["process"].send_signal(signal.SIGSTOP)
                    try:
                        shapes = [motion.at(t) for t in np.arange(8) / 60]
                        for k in range(20_000):  # one that waited would wait for ever
                            sent = session.frame(1, 1, k / 60, shapes[k % 8])
                            if sent is rustle.Sent.DROPPED:
                                break
                        self.assertIs(sent, rustle.Sent.DROPPED)
                        self.assertEqual(session.dropped_messages, 1)
                        deadline = time.monotonic() + 10
                        while reconnect and session.connected:  # taken for gone
                            session.frame(1, 1, 350 + time.monotonic(), shapes[0])
                            self.assertLess(time.monotonic(), deadline)
                            time.sleep(0.01)
                        if reconnect:
                            session.add_topology(2, motion.triangles)
                    finally:
                        ends["process"].send_signal(signal.SIGCONT)
                    time.sleep(0.5)
                    deadline = time.monotonic() + 10
                    while session.frame(1, 1, 400 + time.monotonic(), shapes[0]) is rustle.Sent.DROPPED:
                        self.assertLess(time.monotonic(), deadline)
                        time.sleep(0.01)
                    session.frame(1, 2 if reconnect else 1, 400 + time.monotonic(), shapes[0])
                    session.end()
                    statistics = session.detach()
                    self.assertEqual((session.reattached, statistics.frames_dropped.get("unknown_topology", 0)), (0, 0))


class WhatStands(unittest.TestCase):
    """What a daemon that starts anew is told."""

    def told(self, standing):
        return {message.WhichOneof("body"): message for message in standing.messages()}

    def test_obstacles_as_they_are_now(self):
        standing, vertices = Standing(), np.zeros((3, 3), np.float32)
        for k in range(3):
            shape = rustle.Mesh(np.array([[0, 1, 2]]), vertices)
            message = session_pb2.StreamMessage()
            messages.write_scene(k, [rustle.Obstacle(k, shape)], {}, {}, [], message.scene)
            standing.take(message)
        message = session_pb2.StreamMessage()
        messages.write_scene(5, [], {1: rustle.Pose((1, 2, 3))}, {2: vertices + 1}, [0], message.scene)
        standing.take(message)
        scene = self.told(standing)["scene"].scene
        self.assertEqual((scene.time_s, [obstacle.obstacle_id for obstacle in scene.obstacles]), (5, [1, 2]))
        self.assertEqual((scene.obstacles[0].pose.position.y, scene.obstacles[1].mesh.vertices), (2, (vertices + 1).tobytes()))

    def test_topologies_that_may_still_be_used(self):
        standing = Standing()
        for k in range(1, 201):
            standing.take(session_pb2.StreamMessage(topology=sheet_pb2.Topology(topology_id=k)))
            if k <= 150:
                standing.take(session_pb2.StreamMessage(frame=sheet_pb2.MeshFrame(sheet_id=7, topology_id=k, time_s=k)))
        kept = {message.topology.topology_id for message in standing.messages()}
        self.assertEqual(kept, set(range(150 - 64, 201)))
        self.assertEqual(standing.newest_time_s, 150)


class Restarts(RustleTest):
    """A daemon killed without a word, and started again at the same endpoints."""

    def start(self):
        """Seconds of time.monotonic() when the daemon answers; it is killed at the test's end."""
        ends = {name: f"ipc://{self.folder}/{name}" for name in ("control", "stream", "out")}
        self.control = ends["control"]
        self.process = subprocess.Popen([BIN / "rustled", *(part for name, end in ends.items() for part in (f"--{name}", end)),
                                         "--http", "off", "--log-level", "off"])
        self.addCleanup(self.process.wait)
        self.addCleanup(self.process.kill)
        rustle.Connection.connect(self.control, 20).close()
        return time.monotonic()

    def kill(self):
        self.process.kill()
        self.process.wait()

    def test_a_live_session_is_heard_again(self):
        motion = Motion()
        self.start()
        with rustle.Connection.connect(self.control) as connection, rustle.Session.attach(connection, options(LIVE)) as session:
            heard, going, failures = [], threading.Event(), []
            reader = session.listen(rustle.ListenOptions(blocks=1))

            def simulate():
                try:
                    session.scene(0, obstacles=[rustle.Obstacle(1, rustle.Plane(), reflecting=True)])
                    session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                    start = time.monotonic()
                    while not going.is_set():
                        now = time.monotonic() - start
                        session.frame(1, 1, now, motion.at(now) + np.float32([0, 0, 0.1]))
                        time.sleep(1 / 60)
                except Exception as error:
                    failures.append(error)

            def wait_for(condition, seconds):
                deadline = time.monotonic() + seconds
                while time.monotonic() < deadline:
                    block = reader.next(0.2)
                    if block is not None:
                        heard.append((time.monotonic(), block))
                        if condition(block):
                            return heard[-1][0]
                raise AssertionError(f"not heard within {seconds} s; {failures}")

            loud = lambda block: np.abs(block.samples).max() > 1e-3
            thread = threading.Thread(target=simulate)
            thread.start()
            try:
                wait_for(loud, 10)
                for turn in range(2):
                    self.kill()
                    while reader.next(0.8) is not None:
                        pass
                    there = self.start()
                    heard.clear()
                    wait_for(lambda block: block.restarted, 10)
                    again = wait_for(loud, 10)
                    restarted = next(block for _, block in heard if block.restarted)
                    self.assertGreater(restarted.missing_samples, 0.7 * restarted.rate_hz)
                    self.assertLess(again - there, 3)  # 1 s, and what a busy machine takes
            finally:
                going.set()
                thread.join(10)
            self.assertEqual(failures, [])
            self.assertEqual((session.reattached, session.connected), (2, True))
            self.assertGreater(session.dropped_messages, 0)
            self.assertEqual([known.session_id for known in connection.list_sessions()], [session.id])
            statistics = session.statistics()
            self.assertEqual(statistics.messages_refused, 0)
            self.assertGreater(statistics.crumpling_events, 0)

    def test_what_was_said_meanwhile_is_told(self):
        motion = Motion()
        self.start()
        with rustle.Connection.connect(self.control) as connection, rustle.Session.attach(connection, options(LIVE)) as session:
            session.add_topology(1, motion.triangles, material_coordinates=motion.material)
            session.frame(1, 1, 0.0, motion.at(0))
            gains = session.set_gains([rustle.Gain(-6, sheet_id=1, kind=rustle.SoundKind.FRICTION), rustle.Gain(-math.inf, material="banknote")])
            session.change_pack(1, "banknote")
            self.kill()
            deadline = time.monotonic() + 10
            while session.connected:
                session.frame(1, 1, time.monotonic(), motion.at(0))
                self.assertLess(time.monotonic(), deadline)
            self.assertIs(session.add_sheet(rustle.SheetOptions(2)), rustle.Sent.QUEUED)
            self.assertIs(session.add_topology(2, motion.triangles[:-1], len(motion.material)), rustle.Sent.QUEUED)
            self.start()
            now = time.monotonic()
            while not session.connected:
                session.frame(2, 2, time.monotonic(), motion.at(0))
                self.assertLess(time.monotonic(), now + 10)
                time.sleep(0.005)
            for _ in range(3):
                session.frame(2, 2, time.monotonic(), motion.at(0))
            self.assertEqual(session.set_gains(), gains)
            self.assertEqual(session.change_pack(1, "", "wooden-table").material, "banknote")
            self.assertEqual(session.change_pack(2, "", "wooden-table").material, "printer-paper")
            self.assertEqual(session.end(), rustle.Sent.QUEUED)
            statistics = session.detach()
            self.assertGreaterEqual(statistics.frames_analysed, 3)
            self.assertEqual(statistics.messages_refused, 0)

    def test_a_simulation_that_asks_for_it_goes_on(self):
        motion, rate = Motion(), 48000
        self.start()
        with rustle.Connection.connect(self.control) as connection:
            with rustle.Session.attach(connection, options(), reconnect=True) as session, session.listen() as reader:
                session.scene(0, obstacles=[rustle.Obstacle(1, rustle.Plane(), rustle.Pose((0, 0, -1)))])
                session.scene(0.1, poses={1: rustle.Pose()})
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                motion.send(session, np.arange(60) / 60)
                session.drain()
                before = [reader.next(5)]
                while before[-1].time_s + len(before[-1].samples) / rate < 0.9:
                    before.append(reader.next(5))
                self.kill()
                starter = threading.Timer(0.5, self.start)
                starter.start()
                motion.send(session, 1 + np.arange(60) / 60)  # waits for the daemon
                session.end()
                session.drain()
                starter.join()
                statistics = session.statistics()
                after = list(reader)
        self.assertEqual((session.reattached, statistics.frames_analysed, statistics.messages_refused), (1, 60, 0))
        self.assertGreater(statistics.friction_episodes, 0)  # the table stands where it was moved to
        self.assertGreater(statistics.crumpling_events, 0)
        restarts = [k for k, block in enumerate(after) if block.restarted]
        self.assertEqual(len(restarts), 1)
        k = restarts[0]
        last = (before + after)[len(before) + k - 1]
        self.assertAlmostEqual(after[k].time_s - after[k].first_sample / rate, int(59 / 60 * rate) / rate, places=9)
        self.assertEqual(after[k].missing_samples, round((after[k].time_s - last.time_s) * rate) - len(last.samples))
        self.assertTrue(all(block.missing_samples == 0 for block in after[k + 1:]))
        self.assertAlmostEqual(after[-1].time_s, 2.0, delta=1.5)
        self.assertGreater(max(np.abs(block.samples).max() for block in after[k:]), 1e-3)

    def test_a_simulation_does_not_go_on_by_itself(self):
        motion = Motion()
        self.start()
        with rustle.Connection.connect(self.control) as connection:
            with rustle.Session.attach(connection, options()) as session:
                session.add_topology(1, motion.triangles)
                motion.send(session, np.arange(5) / 60)
                session.drain()
                self.kill()
                self.start()
                with self.assertRaises(rustle.SessionLost) as caught:
                    motion.send(session, 1 + np.arange(1000) / 60)
            self.assertEqual(caught.exception.code_name, "unknown_session")
            self.assertTrue(caught.exception.remedy)

    def test_a_dead_daemon_is_noticed_and_named(self):
        motion = Motion()
        for clock in (LIVE, SIMULATION):
            with self.subTest(clock=clock):
                self.start()
                with rustle.Connection.connect(self.control) as connection:
                    with rustle.Session.attach(connection, options(clock), reconnect=False) as session:
                        reader = session.listen()
                        session.add_topology(1, motion.triangles)
                        self.kill()
                        with self.assertRaises(rustle.Unreachable) as caught:
                            for k in range(1000):  # 10 s: 2 s, and what a busy machine takes
                                session.frame(1, 1, k / 100, motion.at(0))
                                time.sleep(0.01)
                        self.assertIn(self.control, str(caught.exception))
                        self.assertIn("start it again", caught.exception.remedy)
                        with self.assertRaises(rustle.Unreachable):
                            connection.list_sessions()
                        with self.assertRaises(rustle.Unreachable):
                            list(reader)
                    self.assertIsInstance(caught.exception, ConnectionError)


if __name__ == "__main__":
    main()
