#!/usr/bin/python3
"""Keys: who may do what at a daemon that is reached from elsewhere, and that nobody else gets anywhere.

A CURVE socket without a ZAP handler admits any key that knows the server's, so that honest clients get in proves nothing: a hundred
attempts of every kind to get in by other means must reach no session, no decoder and no sound.
"""
import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import zmq
import zmq.auth
from zmq.utils.monitor import recv_monitor_message

from support import BIN, BUILD, RustleTest, daemon, main, read_wav, save_npz, table
from support import rustle as run_rustle

sys.path.insert(0, str(BUILD / "python"))
import rustle
from python_sdk_test import Motion, options
from rustle.v1 import session_pb2

SIMULATION, LIVE = rustle.Clock.SIMULATION, rustle.Clock.LIVE
ATTEMPTS = 100


class KeysTest(RustleTest):
    """A daemon's folder of keys, and clients'."""

    def setUp(self):
        super().setUp()
        self.server = self.folder / "server"
        run_rustle("keys", "new", "server", "--folder", self.server)

    def client(self, name, *may):
        """A folder of keys of its own, allowed to do this."""
        folder = self.folder / name
        run_rustle("keys", "new", name, "--folder", folder)
        (folder / "server.key").write_bytes((self.server / "server.key").read_bytes())
        if may:
            run_rustle("keys", "allow", folder / f"{name}.key", *may, "--folder", self.server)
        return folder

    def keys(self, name, *may):
        return rustle.Keys.read(self.client(name, *may))

    def daemon(self, *more):
        self.log = self.folder / "log"
        return daemon(self.folder, "--keys", self.server, *more, log=self.log)


def connect(ends, keys, timeout_s=5.0):
    return rustle.Connection.connect(ends["control"], timeout_s, keys=keys)


def wait_for(what, seconds=10):
    deadline = time.monotonic() + seconds
    while not (got := what()):
        if time.monotonic() > deadline:
            raise AssertionError("it did not come within %g s" % seconds)
        time.sleep(0.01)
    return got


class Permitted(KeysTest):
    def test_a_client_publishes_and_hears_its_own(self):
        alice = self.keys("alice", "--publish")
        motion = Motion()
        with daemon(self.folder) as ends:
            with rustle.Connection.connect(ends["control"]) as plain, rustle.Session.attach(plain, options()) as session:
                with session.listen() as reader:
                    motion.play(session, 1)
                    expected = reader.read_all()
        with self.daemon() as ends:
            with connect(ends, alice) as connection, rustle.Session.attach(connection, options()) as session:
                with session.listen() as reader, session.observe() as observations:
                    motion.play(session, 1)
                    heard = reader.read_all()
                    self.assertIsNotNone(observations.next(5))
                self.assertEqual(session.poll_notices(), [])
                self.assertEqual(session.detach().frames_analysed, 60)
        np.testing.assert_array_equal(heard.samples, expected.samples)

    def test_asyncio(self):
        alice = self.keys("alice", "--publish")

        async def hear(session, motion):
            async with session.listen_async() as reader:
                await asyncio.to_thread(motion.play, session, 0.5)
                return await reader.read_all()

        with self.daemon() as ends, connect(ends, alice) as connection, rustle.Session.attach(connection, options()) as session:
            sound = asyncio.run(hear(session, Motion()))
        self.assertGreater(len(sound.samples), 20000)

    def test_commands_take_a_folder_or_the_environment(self):
        alice, bob = self.client("alice", "--publish"), self.client("bob", "--listen", "--admin")
        motion, times = Motion(), np.arange(30) / 60
        npz = save_npz(self.folder / "sheet.npz", [motion.at(t) for t in times], motion.triangles, times,
                       material_coordinates=motion.material, **table())
        capture = self.import_npz(npz)
        with self.daemon() as ends:
            wav = self.folder / "heard.wav"
            run_rustle("replay", capture, "--clock", "simulation", "--control", ends["control"], "--keys", alice, "--wav", wav)
            self.assertGreater(len(read_wav(wav)[1]), 20000)
            environment = {**os.environ, "RUSTLE_KEYS": str(bob)}
            run_rustle("pack", "reload", "--control", ends["control"], env=environment)
            done = run_rustle("pack", "reload", "--control", ends["control"], "--keys", alice, status=1)
            self.assertIn("permission_denied", done.stderr)

    def test_a_session_goes_on_at_a_daemon_that_was_started_again(self):
        alice, motion = self.keys("alice", "--publish"), Motion()
        with self.daemon() as ends:
            connection = connect(ends, alice)
            session = rustle.Session.attach(connection, options(LIVE))
            reader = session.listen()
            session.add_topology(1, motion.triangles, material_coordinates=motion.material)
            session.frame(1, 1, 0, motion.at(0))
        with self.daemon() as ends:
            frame = iter(range(1, 10_000))

            def heard_again():
                k = next(frame)
                session.frame(1, 1, k / 60, motion.at(k / 60))
                time.sleep(1 / 120)
                block = reader.next(0)
                return session.reattached and block is not None
            wait_for(heard_again, 20)
            session.detach()
            connection.close()

    def test_certificates_of_pyzmq(self):
        folder = self.folder / "carol"
        folder.mkdir()
        zmq.auth.create_certificates(folder, "carol", {"permissions": "admin"})  # its own wish, which nobody asks
        (folder / "server.key").write_bytes((self.server / "server.key").read_bytes())
        run_rustle("keys", "allow", folder / "carol.key", "--publish", "--folder", self.server)
        self.assertIn("publish", run_rustle("keys", "list", "--folder", self.server).stdout)
        self.assertNotIn("admin", run_rustle("keys", "list", "--folder", self.server).stdout)
        public, secret = zmq.auth.load_certificate(self.server / "server.key_secret")
        self.assertTrue(public and secret)
        with self.daemon() as ends, connect(ends, rustle.Keys.read(folder)) as connection:
            self.assertRaises(rustle.Refused, connection.reload_pack)
            rustle.Session.attach(connection, options()).detach()

    def test_what_a_key_may_not(self):
        alice, bob = self.keys("alice", "--publish"), self.keys("bob", "--publish")
        ears, boss = self.keys("ears", "--listen"), self.keys("boss", "--admin")
        with self.daemon("--recordings", self.folder / "takes") as ends:
            a, b, e, z = (connect(ends, keys) for keys in (alice, bob, ears, boss))
            session = rustle.Session.attach(a, options(LIVE))
            self.assertEqual([s.session_id for s in a.list_sessions()], [session.id])
            self.assertEqual(b.list_sessions(), [])
            self.assertEqual([s.session_id for s in e.list_sessions()], [session.id])
            gains = [rustle.Gain(-6.0)]
            for other in (b, e):
                for forbidden in (lambda: other.detach(session.id), lambda: other.set_gains(session.id, gains),
                                  lambda: other.change_pack(session.id, 1, "banknote"), other.reload_pack,
                                  lambda: other.start_recording(session.id, "take"), lambda: other.stop_recording(session.id)):
                    with self.assertRaises(rustle.Refused) as refused:
                        forbidden()
                    self.assertEqual(refused.exception.code_name, "permission_denied")
            self.assertRaises(rustle.Refused, b.statistics, session.id)
            self.assertRaises(rustle.Refused, b.server_statistics)
            self.assertEqual(e.statistics(session.id).session_id, session.id)
            with self.assertRaises(rustle.Refused) as refused:
                rustle.Session.attach(e, options())
            self.assertEqual(refused.exception.code_name, "permission_denied")
            with self.assertRaises(rustle.Refused) as refused:
                rustle.PcmReader.listen(b, session.id)
            self.assertIn("may not hear sheet/pcm", refused.exception.message)
            for keys in (e, z):
                rustle.PcmReader.listen(keys, session.id).close()
            self.assertEqual(len(z.set_gains(session.id, gains)), 1)
            self.assertEqual(z.start_recording(session.id, "take"), "take.mcap")
            z.detach(session.id)
            for connection in (a, b, e, z):
                connection.close()

    def test_a_session_of_the_same_name_is_not_heard_by_who_heard_the_one_before(self):
        alice, bob = self.keys("alice", "--publish"), self.keys("bob", "--publish")
        motion = Motion()
        with self.daemon() as ends, connect(ends, alice) as a, connect(ends, bob) as b:
            with rustle.Session.attach(b, options(LIVE)) as session:
                left = rustle.PcmReader.listen(b, session.id)
            wait_for(lambda: not a.list_sessions() and not b.list_sessions())
            with rustle.Session.attach(a, options()) as session, session.listen() as reader:
                while left.next(0) is not None:
                    pass
                motion.play(session, 0.5)
                self.assertGreater(len(reader.read_all().samples), 20000)
                self.assertIsNone(left.next(0.5))
            left.close()

    def test_publishers_that_rustled_connects_to_prove_their_key(self):
        keys, boss_keys = self.keys("sim", "--publish"), self.keys("boss", "--admin")
        context = zmq.Context()
        self.addCleanup(context.destroy, 0)
        sockets = []
        for secret in (keys.secret_key.encode(), zmq.curve_keypair()[1]):
            socket = context.socket(zmq.PUB)
            socket.curve_server, socket.curve_secretkey = True, secret
            sockets.append((socket, socket.bind_to_random_port("tcp://127.0.0.1")))
        connections = [f"--connect=tcp://127.0.0.1:{port}#sim" for _, port in sockets]
        with self.daemon(*connections) as ends, connect(ends, boss_keys) as boss:
            def announced():
                for (socket, _), name in zip(sockets, ("true", "false")):
                    message = session_pb2.StreamMessage(session_id=name)
                    message.announcement.protocol_version = 1
                    socket.send_multipart([name.encode(), message.SerializeToString()])
                return boss.list_sessions()
            self.assertEqual([s.session_id for s in wait_for(announced)], ["true"])
            for _ in range(30):
                announced()
                time.sleep(0.01)
            self.assertEqual([s.session_id for s in announced()], ["true"])


class Quotas(KeysTest):
    def test_sessions_triangles_frames_bytes_and_voices(self):
        motion = Motion()
        few = self.keys("few", "--publish", "--sessions", 2, "--triangles", 300, "--voices", 7)
        slow = self.keys("slow", "--publish", "--frames-per-s", 20)
        thin = self.keys("thin", "--publish", "--bytes-per-s", 20_000)
        with self.daemon() as ends:
            with connect(ends, few) as connection:
                first = rustle.Session.attach(connection, options())
                second = rustle.Session.attach(connection, options())
                self.assertEqual(first.options.most_voices, 7)
                with self.assertRaises(rustle.Refused) as refused:
                    rustle.Session.attach(connection, options())
                self.assertEqual(refused.exception.code_name, "quota_exceeded")
                for session in (first, second):  # 256 triangles each, 300 of both together
                    session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                    session.frame(1, 1, 0, motion.at(0))
                    session.drain(5)
                self.assertEqual(first.statistics().frames_analysed, 1)
                self.assertEqual(second.statistics().frames_dropped, {"quota": 1})
                self.assertEqual([notice.code for notice in second.poll_notices()], ["quota_exceeded"])
                first.detach()
                second.detach()
            for keys in (slow, thin):
                with connect(ends, keys) as connection:
                    with rustle.Session.attach(connection, options(LIVE)) as session:
                        session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                        motion.send(session, np.arange(60) / 60)
                        figures = wait_for(lambda: (s := session.statistics()).frames_received >= 60 and s)
                        self.assertGreater(figures.frames_dropped["quota"], 10)
                        self.assertLess(figures.frames_dropped["quota"], 60)
                        self.assertIn("quota_exceeded", [notice.code for notice in session.poll_notices()])
                    # Simulations wait, and lose nothing.
                    with rustle.Session.attach(connection, options()) as session:
                        begun = time.monotonic()
                        motion.play(session, 1)
                        session.drain(60)
                        figures = session.statistics()
                        self.assertEqual((figures.frames_analysed, figures.frames_dropped), (60, {}))
                        self.assertGreater(time.monotonic() - begun, 0.5)


class Revoked(KeysTest):
    def test_revoking_a_key_ends_its_sessions_and_cuts_its_listeners(self):
        alice, ears = self.keys("alice", "--publish"), self.keys("ears", "--listen")
        bob, motion = self.keys("bob", "--publish"), Motion()
        with self.daemon() as ends:
            a, e, b = (connect(ends, keys) for keys in (alice, ears, bob))
            sessions = [rustle.Session.attach(c, options(LIVE, name=name)) for c, name in ((a, "of alice"), (b, "of bob"))]
            readers = [rustle.PcmReader.listen(e, "of bob"), sessions[1].listen()]
            for session in sessions:
                session.add_topology(1, motion.triangles, material_coordinates=motion.material)
                session.frame(1, 1, 0, motion.at(0))
            for reader in readers:
                self.assertIsNotNone(reader.next(5))
            for name in ("alice", "ears"):
                run_rustle("keys", "revoke", name, "--folder", self.server)
            self.assertEqual(len(b.list_sessions()), 1)
            self.assertEqual(a.statistics("of alice").session_id, "of alice")  # until it is told
            ends["process"].send_signal(signal.SIGHUP)
            wait_for(lambda: "read again" in self.log.read_text())
            for connection in (a, e):
                with self.assertRaises(rustle.RustleError):
                    connection.list_sessions()
            while readers[0].next(0.2) is not None:
                pass
            for k in range(1, 30):
                sessions[1].frame(1, 1, k / 60, motion.at(k / 60))
                self.assertIsNotNone(readers[1].next(5))
            self.assertIsNone(readers[0].next(0.2))
            self.assertIn('The session "of alice" has ended: its key may not publish', self.log.read_text())
            self.assertNotIn('The session "of bob" has ended', self.log.read_text())
            sessions[0].abandon()
            sessions[1].detach()
            for connection in (a, e, b):
                connection.close()

    def test_a_broken_key_changes_nothing(self):
        alice = self.keys("alice", "--publish")
        with self.daemon() as ends, connect(ends, alice) as connection:
            (self.server / "allowed/broken.key").write_text("curve\n    public-key = \"short\"\n")
            ends["process"].send_signal(signal.SIGHUP)
            wait_for(lambda: "All stay as they are" in self.log.read_text())
            self.assertIn("broken.key:2", self.log.read_text())
            connection.ping()
        done = subprocess.run([BIN / "rustled", "--keys", self.server, "--http", "off"], capture_output=True, text=True, timeout=20)
        self.assertEqual(done.returncode, 1)
        self.assertIn("broken.key:2", done.stderr)


class Start(KeysTest):
    def run_daemon(self, *more):
        ports = [f"--{name}=tcp://0.0.0.0:*" for name in ("control", "stream", "out")]
        try:
            done = subprocess.run([BIN / "rustled", *ports, "--http", "off", *more], capture_output=True, text=True, timeout=3)
            return done.returncode, done.stderr
        except subprocess.TimeoutExpired as running:
            return None, running.stderr.decode()

    def test_beyond_this_machine_only_with_keys_or_insecure(self):
        status, said = self.run_daemon()
        self.assertEqual(status, 1)
        for word in ("--control", "--keys", "127.0.0.1", "--insecure"):
            self.assertIn(word, said)
        status, said = self.run_daemon("--insecure")
        self.assertIsNone(status)
        self.assertIn("whoever reaches", said)
        self.assertIsNone(self.run_daemon("--keys", self.server)[0])
        os.chmod(self.server / "server.key_secret", 0o644)
        status, said = self.run_daemon("--keys", self.server)
        self.assertEqual(status, 1)
        self.assertIn("chmod 600", said)

    def test_an_endpoint_of_all_addresses_is_found_where_the_daemon_is(self):
        alice = self.client("alice", "--publish")
        log = self.folder / "log"
        ends = [f"--{name}=tcp://0.0.0.0:*" for name in ("control", "stream", "out")]
        with open(log, "w") as said:
            process = subprocess.Popen([BIN / "rustled", *ends, "--http", "off", "--keys", self.server], stderr=said)
        try:
            port = wait_for(lambda: "control tcp" in log.read_text()) and log.read_text().split("control tcp://0.0.0.0:")[1].split(",")[0]
            with rustle.Connection.connect(f"tcp://127.0.0.1:{port}", keys=rustle.Keys.read(alice)) as connection:
                with rustle.Session.attach(connection, options()) as session, session.listen() as reader:
                    Motion().play(session, 0.2)
                    self.assertGreater(len(reader.read_all().samples), 5000)
        finally:
            process.terminate()
            process.wait(10)


class Forged(KeysTest):
    """A hundred attempts of each kind, while alice's session goes on and its owner hears it without a gap."""

    def setUp(self):
        super().setUp()
        self.alice = self.keys("alice", "--publish")
        self.boss = self.keys("boss", "--admin")
        self.mallory = self.keys("mallory", "--publish")
        self.context = zmq.Context()
        self.context.max_sockets = 4000
        self.addCleanup(self.context.destroy, 0)
        self.motion = Motion()

    def frame_bytes(self, session_id="flag", time_s=1e6):
        message = session_pb2.StreamMessage(session_id=session_id, sequence=1_000_000)
        message.frame.sheet_id, message.frame.topology_id, message.frame.time_s = 1, 1, time_s
        message.frame.positions = self.motion.at(0).tobytes()
        return message.SerializeToString()

    def guarded(self, attack):
        """Runs the attack beside a session named flag; nothing of the attack may be there afterwards."""
        with self.daemon() as ends, connect(ends, self.alice) as a, connect(ends, self.boss) as boss:
            with rustle.Session.attach(a, options(LIVE, name="flag")) as session, session.listen() as reader:
                session.add_topology(1, self.motion.triangles, material_coordinates=self.motion.material)
                self.sent = 0

                def goes_on(frames=1):
                    for _ in range(frames):
                        session.frame(1, 1, self.sent / 60, self.motion.at(self.sent / 60))
                        self.sent += 1
                goes_on(3)
                self.assertIsNotNone(reader.next(5))
                attack(ends, boss, goes_on)
                goes_on(3)
                wait_for(lambda: boss.statistics("flag").frames_received >= self.sent)
                figures = boss.statistics("flag")
                self.assertEqual(figures.frames_received, self.sent)
                self.assertEqual(figures.messages_received, self.sent + 1)
                self.assertEqual(figures.messages_refused, 0)
                self.assertNotIn("mine", [s.session_id for s in boss.list_sessions()])
                self.assertIsNotNone(reader.next(5))
                self.assertEqual(reader.missing_messages, 0)
                self.assertEqual(session.poll_notices(), [])

    def socket(self, kind, prepare, endpoint):
        """A socket prepared like this, and its monitor."""
        socket = self.context.socket(kind)
        socket.linger = 0
        socket.reconnect_ivl = -1
        if kind == zmq.SUB:
            socket.subscribe("")
        prepare(socket)
        events = socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_DISCONNECTED |
                                           zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)
        socket.connect(endpoint)
        return socket, events

    def strangers(self, prepare):
        """A hundred that no handshake should admit, at each of the three endpoints."""
        def attack(ends, boss, goes_on):
            attach = session_pb2.ControlRequest(request_id=1)
            attach.attach.name = "mine"
            message = session_pb2.StreamMessage(session_id="mine")
            message.announcement.protocol_version = 1
            for begin in range(0, ATTEMPTS, 20):
                kinds = ((zmq.DEALER, "control"), (zmq.PUB, "stream"), (zmq.SUB, "out"))
                made = [(kind, *self.socket(kind, prepare, ends[name])) for _ in range(20) for kind, name in kinds]
                for kind, socket, events in made:
                    if kind == zmq.DEALER:
                        with contextlib.suppress(zmq.Again):  # it was turned away already
                            socket.send(attach.SerializeToString(), zmq.NOBLOCK)
                    self.assertTrue(events.poll(10_000), "no handshake was tried")
                    event = recv_monitor_message(events)["event"]
                    self.assertNotEqual(event, zmq.EVENT_HANDSHAKE_SUCCEEDED)
                    if kind == zmq.PUB:
                        socket.send_multipart([b"flag", self.frame_bytes()])
                        socket.send_multipart([b"mine", message.SerializeToString()])
                goes_on()
                for kind, socket, events in made:
                    if kind != zmq.PUB:
                        self.assertEqual(socket.poll(0), 0, "something was answered")
                    socket.disable_monitor()
                    events.close()
                    socket.close()
        self.guarded(attack)

    def test_a_key_that_is_not_allowed(self):
        def prepare(socket):
            socket.curve_serverkey = self.alice.server_key.encode()
            socket.curve_publickey, socket.curve_secretkey = zmq.curve_keypair()
        self.strangers(prepare)

    def test_an_allowed_public_key_without_its_secret(self):
        def prepare(socket):
            socket.curve_serverkey = self.alice.server_key.encode()
            socket.curve_publickey, socket.curve_secretkey = self.alice.public_key.encode(), zmq.curve_keypair()[1]
        self.strangers(prepare)

    def test_the_servers_key_is_not_known(self):
        def prepare(socket):
            socket.curve_serverkey = zmq.curve_keypair()[0]
            socket.curve_publickey, socket.curve_secretkey = self.alice.public_key.encode(), self.alice.secret_key.encode()
        self.strangers(prepare)

    def test_no_key(self):
        self.strangers(lambda socket: None)

    def test_no_key_but_a_zap_domain(self):
        def prepare(socket):
            socket.zap_domain = b"rustle"
        self.strangers(prepare)

    def test_user_and_password(self):
        def prepare(socket):
            socket.plain_username, socket.plain_password = b"alice", self.alice.public_key.encode()
        self.strangers(prepare)

    def as_mallory(self, socket):
        socket.curve_serverkey = self.mallory.server_key.encode()
        socket.curve_publickey, socket.curve_secretkey = self.mallory.public_key.encode(), self.mallory.secret_key.encode()

    def test_a_stolen_routing_id(self):
        def ask(socket, request):
            socket.send(request.SerializeToString())
            self.assertTrue(socket.poll(5000))
            return session_pb2.ControlReply.FromString(socket.recv())

        def attack(ends, boss, goes_on):
            owner = self.context.socket(zmq.DEALER)
            owner.linger, owner.routing_id = 0, b"alice's"
            owner.curve_serverkey = self.alice.server_key.encode()
            owner.curve_publickey, owner.curve_secretkey = self.alice.public_key.encode(), self.alice.secret_key.encode()
            owner.connect(ends["control"])
            asking = session_pb2.ControlRequest(request_id=7, session_id="flag")
            asking.get_statistics.SetInParent()
            def steal():
                """Whether the daemon took the routing id; what it answered then."""
                thief = self.context.socket(zmq.DEALER)
                thief.linger, thief.routing_id = 0, b"alice's"
                self.as_mallory(thief)
                thief.connect(ends["control"])
                answers = 0
                for fill in (lambda r: r.detach.SetInParent(), lambda r: r.get_statistics.SetInParent(), lambda r: r.set_gains.gains.add(gain_db=-60)):
                    request = session_pb2.ControlRequest(request_id=1, session_id="flag")
                    fill(request)
                    thief.send(request.SerializeToString())
                    if not thief.poll(100):
                        break
                    reply = session_pb2.ControlReply.FromString(thief.recv())
                    self.assertEqual(reply.error.code, session_pb2.ERROR_CODE_PERMISSION_DENIED)
                    answers += 1
                thief.close()
                return answers == 3
            # The owner is there, so that its routing id is taken; and then not, so that it is free.
            for _ in range(ATTEMPTS):
                self.assertTrue(ask(owner, asking).HasField("statistics"))
                self.assertFalse(steal())
                goes_on()
            owner.close()
            for _ in range(ATTEMPTS):
                wait_for(steal)
                goes_on()
        self.guarded(attack)

    def test_anothers_topic(self):
        def attack(ends, boss, goes_on):
            with connect(ends, self.mallory) as m, rustle.Session.attach(m, options(LIVE, name="own")) as own:
                ears = self.context.socket(zmq.SUB)
                self.as_mallory(ears)
                for topic in ("", "f", "flag", "flag/", "flag/pcm/mix/f32/4", "flag/notices", "flag/observations"):
                    ears.subscribe(topic)
                ears.subscribe("subscribed/x")
                ears.connect(ends["out"])
                self.assertTrue(ears.poll(5000))
                topic, answer = ears.recv_multipart()
                self.assertEqual(topic, b"subscribed/x")
                error = session_pb2.Error.FromString(answer)
                self.assertEqual((error.code, error.permission), (session_pb2.ERROR_CODE_PERMISSION_DENIED, "listen"))
                voice = self.context.socket(zmq.XPUB)
                self.as_mallory(voice)
                voice.connect(ends["stream"])
                self.assertTrue(voice.poll(5000))
                mine = session_pb2.StreamMessage(session_id=own.id)
                for k in range(ATTEMPTS):
                    voice.send_multipart([b"flag", self.frame_bytes(time_s=1e6 + k)])
                    voice.send_multipart([b"flag", self.frame_bytes("own", 1e6 + k)])
                    voice.send_multipart([b"own", self.frame_bytes("flag", 1e6 + k)])
                    voice.send(self.frame_bytes(time_s=1e6 + k))
                    voice.send_multipart([b"flag", b"\xff" * 100])
                    mine.advance.time_s = k + 1
                    voice.send_multipart([b"own", mine.SerializeToString()])
                    with self.assertRaises(rustle.Refused):
                        m.detach("flag")
                    goes_on()
                wait_for(lambda: boss.statistics("own").messages_received >= ATTEMPTS)
                self.assertEqual(ears.poll(0), 0, "mallory heard something")
                own.detach()
        self.guarded(attack)


if __name__ == "__main__":
    main()
