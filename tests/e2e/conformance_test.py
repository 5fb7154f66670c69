#!/usr/bin/python3
"""C, C++ and Python, driven through tests/conformance/list.txt side by side: each answers as the list says, and all alike."""
import collections
import json
import os
import pathlib
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np
import zmq

from support import BIN, BUILD, SOURCE, RustleTest, bent, curvature_of, grid, main, read_wav, rms_dbfs, save_npz, table, wait_until
from support import rustle as run_rustle

sys.path.insert(0, str(BUILD / "python"))
import rustle
from rustle.v1 import audio_pb2, session_pb2

FOLDER = SOURCE / "tests/conformance"
DRIVERS = {"c": [BUILD / "tests/conformance_c"], "cpp": [BUILD / "tests/conformance_cpp"], "python": [sys.executable, FOLDER / "driver.py"]}
ERRORS = {"invalid_argument", "unreachable", "timed_out", "refused", "session_lost", "closed", "other"}
ANSWER_S = 120


# ---- what the list's files hold

def write_inputs(folder):
    folder.mkdir()
    frames = np.arange(60)
    for name, columns, rows in (("bent", 16, 8), ("fine", 20, 10)):
        material, triangles = grid(0.2, 0.1, columns, rows)
        curvature = curvature_of(0.2, 0.1) * np.sin(2 * np.pi * 4 * frames / 60)
        positions = np.array([bent(material, k) + [0.2 * t / 60, 0, 0.001] for t, k in zip(frames, curvature)], np.float32)
        positions.tofile(folder / f"{name}.positions")
        triangles.astype("<u4").tofile(folder / f"{name}.triangles")
        material.tofile(folder / f"{name}.material")
        if name == "bent":
            save_npz(folder / "bent.npz", positions, triangles, frames / 60, material_coordinates=material, **table())
            np.repeat(positions[:1], 30, 0).tofile(folder / "still.positions")
    np.arange(40, dtype="<u4").tofile(folder / "touching")
    np.zeros(256, "<u4").tofile(folder / "regions")
    table()["obstacle0_triangles"].astype("<u4").tofile(folder / "table.triangles")
    table()["obstacle0_vertices"].tofile(folder / "table.vertices")
    for name, message in refused_messages().items():
        (folder / name).write_bytes(message)


def refused_messages():
    """What no SDK sends by itself: messages that it does not take, and one for each error that a daemon answers with."""
    def frame(sheet=1, topology=1, time_s=3.0, positions=np.zeros((153, 3), "<f4").tobytes()):
        message = session_pb2.StreamMessage()
        message.frame.sheet_id, message.frame.topology_id, message.frame.time_s, message.frame.positions = sheet, topology, time_s, positions
        return message.SerializeToString()

    beyond, removed, long, strange, huge = (session_pb2.StreamMessage() for _ in range(5))
    beyond.topology.topology_id, beyond.topology.vertex_count = 7, 3
    beyond.topology.triangles = np.array([0, 1, 3], "<u4").tobytes()
    removed.scene.time_s = 3.0
    removed.scene.removed_obstacle_ids.append(55)
    long.sheet.sheet_id, long.sheet.name = 4, 1000 * "n"
    strange.sheet.sheet_id, strange.sheet.kind = 4, 99
    huge.topology.triangles = bytes(65 << 20)
    return {"huge": huge.SerializeToString(), "broken": b"\xff\xff\xff", "malformed": frame(positions=b"12345"),
            "not_finite": frame(positions=np.full((153, 3), np.nan, "<f4").tobytes()),
            "unknown_sheet": frame(sheet=77), "unknown_topology": frame(topology=99), "time_order": frame(time_s=0.5),
            "out_of_range": beyond.SerializeToString(), "unknown_obstacle": removed.SerializeToString(), "too_large": long.SerializeToString(),
            "unsupported": strange.SerializeToString()}


# ---- the daemons

class Daemon:
    """rustled, killed and started again at the same endpoints."""

    def __init__(self, folder, *options):
        self.ends = {name: f"ipc://{folder}/{name}" for name in ("control", "stream", "out")}
        self.options = [part for name, end in self.ends.items() for part in (f"--{name}", end)] + [*map(str, options), "--http", "off", "--log-level", "off"]
        self.start()

    def start(self):
        for end in self.ends.values():
            pathlib.Path(end[6:]).unlink(missing_ok=True)
        self.process = subprocess.Popen([BIN / "rustled", *self.options])
        wait_until(lambda: all(pathlib.Path(end[6:]).exists() for end in self.ends.values()), 20, "rustled did not start")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def detach(self):
        with rustle.Connection.connect(self.ends["control"]) as connection:
            for known in connection.list_sessions():
                connection.detach(known.session_id)

    close = kill


class StandIn:
    """Answers, gives credit when it is told to, and publishes notices; nothing sounds."""

    def __init__(self, folder, window, version=1):
        self.window, self.version = window, version
        self.ends = {name: f"ipc://{folder}/{name}" for name in ("control", "stream", "out")}
        self.context = zmq.Context()
        self.control, self.stream, self.out = (self.context.socket(kind) for kind in (zmq.ROUTER, zmq.SUB, zmq.XPUB))
        self.stream.subscribe(b"")
        for socket, name in ((self.control, "control"), (self.stream, "stream"), (self.out, "out")):
            socket.linger = 0
            socket.bind(self.ends[name])
        self.messages, self.attached, self.outgoing = {}, [], collections.deque()
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.stop.is_set():
            if self.control.poll(5):
                peer, data = self.control.recv_multipart()
                self.control.send_multipart([peer, self.answer(session_pb2.ControlRequest.FromString(data)).SerializeToString()])
            while self.out.poll(0):
                change = self.out.recv()
                if change.startswith(b"\x01subscribed/"):
                    self.out.send_multipart([change[1:], b""])
            while self.stream.poll(0):
                session, data = self.stream.recv_multipart()
                self.messages[session.decode()].append(session_pb2.StreamMessage.FromString(data))
            while self.outgoing:
                self.out.send_multipart(self.outgoing.popleft())

    def answer(self, request):
        reply = session_pb2.ControlReply(request_id=request.request_id)
        asked = request.WhichOneof("request")
        if asked == "hello":
            reply.welcome.protocol_version, reply.welcome.rate_hz = self.version, 48000
            reply.welcome.stream_endpoint, reply.welcome.out_endpoint = self.ends["stream"], self.ends["out"]
        elif asked == "attach" and request.attach.name.startswith("refuse-"):
            code = int(request.attach.name.removeprefix("refuse-"))
            reply.error.code, reply.error.field, reply.error.message, reply.error.remedy = code, f"field-{code}", "It is wrong.", "Mend it."
        elif asked == "attach":
            reply.attached.session_id = f"s{len(self.messages)}"
            self.messages[reply.attached.session_id] = []
            self.attached.append(request.attach)
            reply.attached.options.CopyFrom(request.attach.options)
            reply.attached.options.rate_hz, reply.attached.options.block_size = 48000, 128
            reply.attached.credit.window_messages = self.window
        elif asked == "get_statistics":
            reply.statistics.session_id = request.session_id
        else:
            reply.detached.SetInParent()
        return reply

    def publish(self, topic, **body):
        for session in self.messages:
            self.outgoing.append([f"{session}/{topic}".encode(), audio_pb2.OutMessage(session_id=session, **body).SerializeToString()])

    def acknowledge(self, sequence):
        self.publish("acknowledgements", credit=audio_pb2.FlowCredit(acknowledged_sequence=sequence, window_messages=self.window))

    def notify(self, code):
        name = session_pb2.ErrorCode.Name(code).removeprefix("ERROR_CODE_").lower()
        self.publish("notices", notice=audio_pb2.Notice(level=audio_pb2.NOTICE_LEVEL_ERROR, code=name, field=f"field-{code}", message="It is wrong.",
                                                        remedy="Mend it.", sequence=code, count=1))

    def close(self):
        self.stop.set()
        self.thread.join()
        self.context.destroy(0)


# ---- the drivers

class Driver:
    def __init__(self, name, folder):
        self.name, self.folder, self.session = name, folder / name, "?"
        self.folder.mkdir(exist_ok=True)
        environment = {**os.environ, "PYTHONPATH": str((BUILD / "python").resolve()), "PYTHONFAULTHANDLER": "1"}
        self.process = subprocess.Popen([*DRIVERS[name]], cwd=self.folder, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)

    def say(self, line):
        self.process.stdin.write(line.encode() + b"\n")

    def hear(self):
        """The answer, without what differs from session to session."""
        if not select.select([self.process.stdout], [], [], ANSWER_S)[0]:
            self.process.send_signal(signal.SIGABRT)  # Python says where it was
            raise AssertionError(f"the driver in {self.name} did not answer within {ANSWER_S} s")
        line = self.process.stdout.readline().decode()
        if not line:
            raise AssertionError(f"the driver in {self.name} ended with status {self.process.wait()}")
        answer = json.loads(line)
        self.session = answer.pop("session", self.session)
        return {name: re.sub(rf"\b{re.escape(self.session)}\b", "SESSION", value) if isinstance(value, str) else value for name, value in answer.items()}

    def sound(self, name):
        return np.fromfile(self.folder / name, "<f4")

    def close(self):
        self.process.stdin.close()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


def items(text):
    """(name, lines) of the list."""
    for part in re.split(r"^== ", text, flags=re.MULTILINE)[1:]:
        title, *lines = part.splitlines()
        yield title.split(":")[0], [line for line in lines if line and not line.startswith("#")]


def words(text):
    return dict(word.split("=", 1) for word in text.split())


class Conformance(RustleTest):
    drivers = {}

    @classmethod
    def setUpClass(cls):
        holder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(holder.cleanup)
        cls.root = pathlib.Path(holder.name)
        write_inputs(cls.root / "in")
        cls.addClassCleanup(cls.end_drivers)

    @classmethod
    def end_drivers(cls):
        for driver in cls.drivers.values():
            driver.close()
        cls.drivers = {}

    def setUp(self):
        super().setUp()
        if not self.drivers:
            type(self).drivers = {name: Driver(name, self.root) for name in DRIVERS}
        self.server, self.control = None, f"ipc://{self.folder}/control"
        self.addCleanup(lambda: self.server and self.server.close())

    def run_item(self, lines):
        for line in [*lines, "close"]:
            try:
                self.act(*line[1:].split()) if line.startswith("!") else self.ask(line)
            except Exception as error:
                self.end_drivers()  # what they answer next would be of this item
                raise AssertionError(f"at `{line}`: {error}") from error

    # ---- commands

    def ask(self, line):
        command, _, expected = line.partition(" => ")
        if command.split()[0] == "connect":
            command += f" control={self.control}"
        for driver in self.drivers.values():
            driver.say(command)
        answers = {name: driver.hear() for name, driver in self.drivers.items()}
        status, *wanted = expected.split() or ["ok"]
        told = {}
        for name, answer in answers.items():
            shown = {key: str(answer.get(key)) for key in words(" ".join(wanted))}
            self.assertEqual((answer["status"], shown), (status, words(" ".join(wanted))), f"{name}: {answer}")
            if status in ERRORS:
                self.assertTrue(answer["code_name"] and answer["message"] and answer["remedy"], answer)
            own_words = ("field", "message", "remedy") if answer.get("code") == 0 else ()  # of that language
            told[name] = {key: value for key, value in answer.items() if key not in own_words}
        self.assertEqual(told["c"], told["python"])
        self.assertEqual(told["cpp"], told["python"])

    # ---- actions

    def act(self, action, *arguments):
        getattr(self, "do_" + action.replace("-", "_"))(*arguments)

    def do_daemon(self, *kinds):
        self.server = Daemon(self.folder, *(["--keys", self.make_keys()] if kinds else []))

    def make_keys(self):
        """Below ../keys: the daemon's own, and a folder of each client's."""
        keys = self.root / "keys"
        run_rustle("keys", "new", "server", "--folder", keys / "server")
        for name, *may in (("alice", "--publish"), ("ears", "--listen"), ("few", "--publish", "--sessions", 3), ("unknown",)):
            run_rustle("keys", "new", name, "--folder", keys / name)
            shutil.copy(keys / "server/server.key", keys / name)
            if may:
                run_rustle("keys", "allow", keys / name / f"{name}.key", *may, "--folder", keys / "server")
        return keys / "server"

    def do_stand_in(self, *arguments):
        self.server = StandIn(self.folder, **{name: int(value) for name, value in words(" ".join(arguments)).items()})

    def do_kill(self):
        self.server.kill()

    def do_start(self):
        self.server.start()

    def do_detach(self):
        self.server.detach()

    def do_acknowledge(self, sequence):
        self.server.acknowledge(int(sequence))

    def do_notify(self, code):
        self.server.notify(int(code))

    def do_taken(self, count):
        counts = lambda: [len(messages) for messages in self.server.messages.values()]
        wait_until(lambda: counts() == len(DRIVERS) * [int(count)], 20, f"not {count} messages of each came")

    def do_alike(self):
        """Apart from session and clock, what each sent is what the others sent."""
        for said in self.server.attached[1:]:
            self.assertEqual(said, self.server.attached[0])
        for of_each in zip(*self.server.messages.values()):
            for message in of_each:
                message.session_id, message.sent_at_s = "", 0
                self.assertEqual(message, of_each[0])

    # ---- what was heard

    def heard(self, name):
        """The same samples from all."""
        sounds = [driver.sound(name) for driver in self.drivers.values()]
        for other in sounds[1:]:
            np.testing.assert_array_equal(other, sounds[0])
        return sounds[0]

    def do_same(self, name):
        told = [(driver.folder / name).read_text() for driver in self.drivers.values()]
        self.assertGreater(len(told[0].splitlines()), 20)
        self.assertEqual(told[0], told[2])
        self.assertEqual(told[1], told[2])

    def do_loud(self, name):
        self.assertGreater(rms_dbfs(self.heard(name)), -60)

    def do_silent(self, name):
        self.assertEqual(np.abs(self.heard(name)).max(), 0)

    def do_rendered(self, name):
        capture, wav = self.root / "bent.mcap", self.root / "rendered.wav"
        run_rustle("import", self.root / "in/bent.npz", "-o", capture, "--no-reflections")
        run_rustle("render", capture, "-o", wav)
        np.testing.assert_array_equal(self.heard(name), read_wav(wav)[1].astype(np.float32).ravel())

    def do_emitters(self, sound, places):
        of_each = [self.emitters(driver, sound, places) for driver in self.drivers.values()]
        self.assertGreater(len(of_each[0]), 5)
        self.assertEqual(of_each[1], of_each[0])
        self.assertEqual(of_each[2], of_each[0])

    def emitters(self, driver, sound, places):
        """By id, kind and first sample: the sound as bytes. Messages may be cut differently."""
        samples, at, under_way, out = driver.sound(sound), 0, {}, {}
        for line in (driver.folder / places).read_text().splitlines():
            first, count, emitter, sheet, kind, last, *place = line.split()
            self.assertEqual(len(place), 6)
            begun, sheet_of, kind_of, sounds = under_way.setdefault(emitter, (first, sheet, kind, []))
            self.assertEqual((sheet_of, kind_of), (sheet, kind))
            sounds.append(samples[at:at + int(count)])
            at += int(count)
            if last == "1":
                out[emitter, kind, begun] = np.concatenate(under_way.pop(emitter)[3]).tobytes()
        self.assertEqual(at, len(samples))
        return out


def test_of(lines):
    def run(self):
        self.run_item(lines)
    return run


for number, (name, lines) in enumerate(items((FOLDER / "list.txt").read_text()), 1):
    setattr(Conformance, f"test_{number:02}_{name}", test_of(lines))

if __name__ == "__main__":
    main()
