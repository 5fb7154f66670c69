#!/usr/bin/python3
"""Injects every fault of the table into a running rustled and prints a line each: injected, expected, seen.
usage: faults.py [--quick] [NAME ...]     see run.sh
"""
import contextlib
import inspect
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "e2e"))
from support import BIN, BUILD, STORED_CAPTURE, daemon

sys.path.insert(0, str(BUILD / "python"))
import rustle
from network import Wire, enter
from python_sdk_test import Motion, options
from rustle.v1 import session_pb2

LIVE, SIMULATION = rustle.Clock.LIVE, rustle.Clock.SIMULATION
MOTION = Motion()
TABLE = []
QUICK = False


def fault(injected, expected):
    """Declares a row; the function injects, asserts, and returns what was seen."""
    def declare(function):
        TABLE.append((function.__name__, injected, expected, function))
        return function
    return declare


def often(many, few):
    return few if QUICK else many


def wait_for(what, seconds=15):
    deadline = time.monotonic() + seconds
    while not (got := what()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {inspect.getsource(what).strip()}"
        time.sleep(0.01)
    return got


def status_of(process):
    """Resident bytes, descriptors and threads."""
    proc = pathlib.Path(f"/proc/{process.pid}")
    told = proc.joinpath("status").read_text()
    return (1024 * int(re.search(r"VmRSS:\s+(\d+)", told)[1]), len(list(proc.joinpath("fd").iterdir())), int(re.search(r"Threads:\s+(\d+)", told)[1]))


class Witness:
    """A live session that goes on beside a fault, and what its listener hears of it."""

    def __init__(self, ends, name="witness"):
        self.connection = rustle.Connection.connect(ends["control"])
        self.session = rustle.Session.attach(self.connection, options(LIVE, name=name))
        self.reader = self.session.listen()
        self.gaps = self.blocks = 0
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self._thread.start()
        wait_for(lambda: self.blocks > 10)

    def _go_on(self):
        self.session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        begun, k = time.monotonic(), 0
        while not self._ends.is_set():
            self.session.frame(1, 1, k / 60, MOTION.at(k / 60))
            k += 1
            while (block := self.reader.next(max(0, begun + k / 60 - time.monotonic()))) is not None:
                self.blocks += 1
                self.gaps += block.missing_samples

    def end(self):
        """Samples missing and blocks heard. \\pre the daemon is there"""
        heard = self.blocks
        wait_for(lambda: self.blocks > heard + 10)
        self._ends.set()
        self._thread.join()
        missing = self.gaps + self.reader.missing_messages
        self.session.detach()
        self.connection.close()
        return missing


@contextlib.contextmanager
def served(*more, **how):
    with tempfile.TemporaryDirectory() as folder, daemon(folder, "--device", "none", *more, log=pathlib.Path(folder) / "log", **how) as ends:
        ends["log"] = pathlib.Path(folder) / "log"
        wait_for(lambda: "control ipc" in ends["log"].read_text(), 60)  # packs are read
        yield ends
        assert ends["process"].poll() is None, "rustled ended: " + ends["log"].read_text()[-2000:]


def play(ends, seconds=0.2):
    """A whole simulation: the daemon serves."""
    with rustle.Connection.connect(ends["control"]) as connection, rustle.Session.attach(connection, options()) as session:
        with session.listen() as reader:
            MOTION.play(session, seconds)
            return len(reader.read_all().samples)


CLIENT = """
import sys; sys.path[:0] = {paths!r}
from faults import *
connection = rustle.Connection.connect({control!r})
session = rustle.Session.attach(connection, options(LIVE, name="victim"))
reader = session.listen()
session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
print("ready", flush=True)
k = 0
while True:
    session.frame(1, 1, k / 60, MOTION.at(k / 60)); k += 1; time.sleep(1 / 60); {each}
"""


def client(ends, each="reader.next(0)"):
    code = CLIENT.format(paths=[str(HERE), str(HERE.parent / "e2e")], control=ends["control"], each=each)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


# ------------------------------------------------------------------------------------------------------------ clients

@fault("a simulator is killed", "its session ends within 20 s, others have no gap")
def client_killed():
    with served() as ends, rustle.Connection.connect(ends["control"]) as asking:
        witness = Witness(ends)
        process = client(ends)
        process.kill()
        process.wait()
        begun = time.monotonic()
        wait_for(lambda: [s.session_id for s in asking.list_sessions()] == ["witness"], 20)
        missing = witness.end()
        assert missing == 0
        return f"gone after {time.monotonic() - begun:.1f} s, {missing} samples missing"


@fault("a listener is stopped (SIGSTOP) for 5 s", "others have no gap, less than 64 MiB more")
def listener_stopped():
    with served() as ends:
        witness = Witness(ends)
        process = client(ends)
        before = status_of(ends["process"])[0]
        process.send_signal(signal.SIGSTOP)
        time.sleep(5)
        more = (status_of(ends["process"])[0] - before) / 2**20
        process.kill()
        process.send_signal(signal.SIGCONT)
        process.wait()
        missing = witness.end()
        assert missing == 0 and more < 64, (missing, more)
        return f"{missing} samples missing, {more:.1f} MiB more"


@fault("10,000 sessions attached and dropped", "within 2 MiB of what it was after the first 1,000; as many descriptors and threads")
def sessions_dropped():
    with served() as ends:
        context = zmq.Context()
        control = context.socket(zmq.DEALER)
        control.linger = 0
        control.connect(ends["control"])

        def ask(requests):
            """All at once; the answers, in any order."""
            for fields in requests:
                request = session_pb2.ControlRequest(request_id=1, session_id=fields.pop("session", ""))
                for name, fill in fields.items():
                    fill(getattr(request, name))
                    getattr(request, name).SetInParent()
                control.send(request.SerializeToString())
            for _ in requests:
                assert control.poll(10_000), "no answer"
                yield session_pb2.ControlReply.FromString(control.recv())

        def attach(request):
            request.options.clock = session_pb2.CLOCK_SIMULATION
            request.sheets.add(sheet_id=1)

        def drop(count):
            while count > 0:
                # A machine that does other things as well may be told to wait.
                sessions = [id for reply in ask([{"attach": attach} for _ in range(20)]) if (id := reply.attached.session_id)]
                time.sleep(0 if sessions else 0.1)
                count -= len(sessions)
                for reply in ask([{"session": session, "detach": lambda m: setattr(m, "discard", True)} for session in sessions]):
                    assert reply.HasField("detached"), str(reply)
        first, rest = often((1000, 9000), (300, 700))
        drop(first)
        before = status_of(ends["process"])
        drop(rest)
        wait_for(lambda: not next(ask([{"list_sessions": lambda m: None}])).session_list.sessions)
        after = status_of(ends["process"])
        control.close()
        context.term()
        more = (after[0] - before[0]) / 2**20
        assert more <= 2 and after[1:] == before[1:], (before, after)
        return f"{more:+.2f} MiB, descriptors {before[1]} and {after[1]}, threads {before[2]} and {after[2]}"


@fault("100,000 mutated frames sent live", "no crash, another session has no gap")
def mutated_frames():
    with served() as ends, rustle.Connection.connect(ends["control"]) as connection:
        witness = Witness(ends)
        session = rustle.Session.attach(connection, options(LIVE, name="mutant"))
        session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        context = zmq.Context()
        voice = context.socket(zmq.XPUB)
        voice.linger, voice.sndhwm, voice.xpub_nodrop = 0, 1000, 1
        voice.connect(ends["stream"])
        assert voice.poll(5000)
        dice, count = random.Random(4), often(100_000, 5_000)
        for k in range(count):
            message = session_pb2.StreamMessage(session_id="mutant", sequence=k + 10)
            message.frame.sheet_id, message.frame.topology_id, message.frame.time_s = 1, 1, k / 1000
            message.frame.positions = MOTION.at(k / 1000).tobytes()
            data = bytearray(message.SerializeToString())
            for _ in range(dice.randrange(1, 6)):
                data[dice.randrange(len(data))] = dice.randrange(256)
            if dice.random() < 0.1:
                del data[dice.randrange(len(data)):]
            while True:
                with contextlib.suppress(zmq.Again):
                    voice.send_multipart([b"mutant", bytes(data)], zmq.NOBLOCK)
                    break
                time.sleep(0.001)
        wait_for(lambda: connection.statistics("mutant").messages_received >= count * 0.9, 60)
        figures = connection.statistics("mutant")
        missing = witness.end()
        voice.close()
        context.term()
        assert missing == 0
        return f"{figures.messages_received} came, {figures.messages_refused} refused, {missing} samples missing"


@contextlib.contextmanager
def served_by_tcp():
    """As served(); ends["ports"] has the three ports."""
    with tempfile.TemporaryDirectory() as folder:
        log = pathlib.Path(folder) / "log"
        with open(log, "w") as said:
            process = subprocess.Popen([BIN / "rustled", *(f"--{n}=tcp://127.0.0.1:*" for n in ("control", "stream", "out")), "--http", "off",
                                        "--device", "none"], stderr=said)
        try:
            wait_for(lambda: "control tcp" in log.read_text())
            ports = [int(port) for port in re.findall(r"(?:control|stream|out) tcp://127.0.0.1:(\d+)", log.read_text())]
            yield {"control": f"tcp://127.0.0.1:{ports[0]}", "ports": ports, "process": process}
            assert process.poll() is None, log.read_text()[-2000:]
        finally:
            process.terminate()
            process.wait(10)


@fault("500 connections that say nothing or nonsense", "others are served meanwhile, and all descriptors come back")
def half_open_connections():
    with served_by_tcp() as ends:
        play(ends)
        before, dice = status_of(ends["process"])[1], random.Random(5)
        sockets = [socket.create_connection(("127.0.0.1", ends["ports"][k % 3])) for k in range(500)]
        for k, one in enumerate(sockets):
            with contextlib.suppress(OSError):
                one.sendall(dice.randbytes(dice.randrange(200)) if k % 2 else b"")
        samples = play(ends)
        wait_for(lambda: status_of(ends["process"])[1] <= before, 10)
        for one in sockets:
            one.close()
        return f"{samples} samples rendered meanwhile, {status_of(ends['process'])[1]} descriptors again"


# ------------------------------------------------------------------------------------------------------------ network

@contextlib.contextmanager
def apart():
    """A daemon in one network, this thread in the other."""
    wire = Wire()
    home = os.open("/proc/thread-self/ns/net", os.O_RDONLY | os.O_CLOEXEC)
    with tempfile.TemporaryDirectory() as folder:
        ports = {"control": 7390, "stream": 7391, "out": 7392}
        with open(pathlib.Path(folder) / "log", "w") as said:
            process = subprocess.Popen([BIN / "rustled", *(f"--{n}=tcp://0.0.0.0:{p}" for n, p in ports.items()), "--insecure", "--http", "off",
                                        "--device", "none"], stderr=said, preexec_fn=lambda: enter(wire.here))
        try:
            enter(wire.there)
            yield wire, {name: f"tcp://{Wire.HERE}:{port}" for name, port in ports.items()}, process
            assert process.poll() is None
        finally:
            enter(home)
            os.close(home)
            process.terminate()
            process.wait(10)
            wire.close()


@fault("5 % of packets lost, 20 to 60 ms late, overtaking each other", "a simulation gives the very same samples")
def packets_lost():
    with served() as ends, rustle.Connection.connect(ends["control"], 30) as connection:
        with rustle.Session.attach(connection, options()) as session, session.listen() as reader:
            MOTION.play(session, 1)
            expected = reader.read_all().samples
    with apart() as (wire, ends, _):
        wire.loss, wire.delay_s, wire.jitter_s = 0.05, 0.02, 0.04
        with rustle.Connection.connect(ends["control"], 30) as connection, rustle.Session.attach(connection, options()) as session:
            with session.listen() as reader:
                MOTION.play(session, 1)
                heard = reader.read_all(60).samples
        assert np.array_equal(heard, expected)
        return f"the same {len(heard)} samples; {wire.lost} packets lost, {wire.overtaken} overtaken of {wire.passed + wire.lost}"


def connected(connection):
    with contextlib.suppress(rustle.RustleError):
        return connection.ping()


@fault("the network is cut for 3 s, and healed", "a live session is heard again within 5 s, under its own name")
def partition():
    with apart() as (wire, ends, _), rustle.Connection.connect(ends["control"], 20) as connection:
        session = rustle.Session.attach(connection, options(LIVE, name="far"))
        reader = session.listen()
        session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        state = {"k": 0, "blocks": 0}

        def step():
            session.frame(1, 1, state["k"] / 60, MOTION.at(state["k"] / 60))
            state["k"] += 1
            time.sleep(1 / 60)
            while reader.next(0) is not None:
                state["blocks"] += 1
            return state["blocks"]
        wait_for(lambda: step() > 20)
        wire.cut = True
        until = time.monotonic() + 3
        while time.monotonic() < until:
            step()
        state["blocks"] = 0
        step()
        wire.cut, healed = False, time.monotonic()
        state["blocks"] = 0
        wait_for(lambda: step() > 20, 5)
        took = time.monotonic() - healed
        assert session.id == "far"
        wait_for(lambda: step() and connected(connection))
        session.detach()
        return f"heard again {took:.1f} s after the network was back"


@fault("a frame stream that comes with 100 ms of jitter", "every frame arrives, and is analysed or counted as dropped; the delay adapts")
def jitter():
    with apart() as (wire, ends, _), rustle.Connection.connect(ends["control"], 20) as connection:
        wire.delay_s, wire.jitter_s = 0.005, 0.1
        session = rustle.Session.attach(connection, options(LIVE, name="far"))
        session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        begun = time.monotonic()
        for k in range(240):
            session.frame(1, 1, k / 60, MOTION.at(k / 60))
            time.sleep(max(0, begun + k / 60 - time.monotonic()))
        figures = wait_for(lambda: (s := session.statistics()).frames_received >= 240 and s)
        assert figures.frames_received == 240 and figures.playout_delay_s > 0.06, figures
        assert figures.frames_analysed + sum(figures.frames_dropped.values()) == 240, figures
        session.detach()
        return f"{figures.frames_analysed} of 240 frames analysed, {sum(figures.frames_dropped.values())} dropped, playout delay {1000 * figures.playout_delay_s:.0f} ms"


# ------------------------------------------------------------------------------------------------------------- system

def shim(folder):
    library = pathlib.Path(folder) / "shim.so"
    subprocess.run(["gcc", "-shared", "-fPIC", "-O1", "-o", library, HERE / "shim.c", "-ldl"], check=True)
    return library


@contextlib.contextmanager
def environment(**variables):
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update({name: str(value) for name, value in variables.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


@fault("the wall clock steps by a day, forth and back", "no gap")
def clock_steps():
    with tempfile.TemporaryDirectory() as place:
        off = pathlib.Path(place) / "off"
        with contextlib.ExitStack() as stack:
            with environment(LD_PRELOAD=shim(place), RUSTLE_FAULT_CLOCK=off):
                ends = stack.enter_context(served("--recordings", pathlib.Path(place) / "takes"))
            witness = Witness(ends)
            name = rustle.Connection.connect(ends["control"]).start_recording("witness", "")
            for seconds in (86400, -86400, 0):
                off.write_text(str(seconds))
                time.sleep(1)
            missing = witness.end()
            assert missing == 0
            return f"{missing} samples missing, recorded to {name}"


def recording_fails(place, ends, begin, end=lambda: None):
    """A recording under way meets a fault: it ends with a notice, the session goes on."""
    with rustle.Connection.connect(ends["control"]) as connection:
        witness = Witness(ends)
        other = rustle.Session.attach(connection, options(LIVE, name="recorded", record=True))
        other.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        state = {"k": 0, "codes": []}

        def step():
            other.frame(1, 1, state["k"] / 60, MOTION.at(state["k"] / 60))
            state["k"] += 1
            time.sleep(1 / 120)
            state["codes"] += [notice.code for notice in other.poll_notices()]
            return state["codes"]
        wait_for(lambda: step() or other.stored_sequence > 10)
        stored = other.stored_sequence
        begin()
        wait_for(lambda: "storage" in step(), 60)
        end()
        analysed = other.statistics().frames_analysed
        wait_for(lambda: step() and other.statistics().frames_analysed > analysed + 20)
        acknowledged = other.stored_sequence
        missing = witness.end()
        other.detach()
        assert missing == 0
        return f"notice storage; {acknowledged} messages acknowledged, {stored} before; {missing} samples missing"


def mounted(place, *mount_options):
    """A small file system of memory at place/takes, unmounted by the caller."""
    takes = pathlib.Path(place) / "takes"
    takes.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join(mount_options), "rustle-faults", takes], check=True)
    return takes


@fault("the disk is full while recording", "the recording ends with a notice, sound goes on")
def disk_full():
    with tempfile.TemporaryDirectory() as place:
        takes = mounted(place, "size=1m")
        try:
            with served("--recordings", takes) as ends:
                filler = takes / "filler"

                def fill():
                    with contextlib.suppress(OSError), open(filler, "wb", buffering=0) as out:
                        while True:
                            out.write(b"x" * 4096)
                return recording_fails(place, ends, fill)
        finally:
            subprocess.run(["umount", "-l", takes], check=True)


@fault("the recording folder becomes read-only", "the next recording is refused with a reason, sound goes on")
def read_only():
    with tempfile.TemporaryDirectory() as place:
        takes = mounted(place, "size=8m")
        try:
            with served("--recordings", takes) as ends, rustle.Connection.connect(ends["control"]) as connection:
                witness = Witness(ends)
                subprocess.run(["mount", "-o", "remount,ro", takes], check=True)
                try:
                    connection.start_recording("witness", "take")
                    raise AssertionError("it was recorded")
                except rustle.Refused as refused:
                    assert refused.code_name == "storage" and "Read-only" in refused.message, refused
                missing = witness.end()
                assert missing == 0
                return f"refused: Read-only file system; {missing} samples missing"
        finally:
            subprocess.run(["umount", "-l", takes], check=True)


@fault("writes of the recording fail with EIO", "the recording ends with a notice, sound goes on")
def input_output_error():
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        flag = pathlib.Path(place) / "fails"
        with environment(LD_PRELOAD=shim(place), RUSTLE_FAULT_WRITE=flag):
            ends = stack.enter_context(served("--recordings", pathlib.Path(place) / "takes"))
        return recording_fails(place, ends, flag.touch, flag.unlink)


@fault("rustled has no descriptors left", "no crash, who is there has no gap, new ones come in when some are free again")
def out_of_descriptors():
    with served_by_tcp() as ends:
        witness = Witness(ends)
        used = status_of(ends["process"])[1]
        resource.prlimit(ends["process"].pid, resource.RLIMIT_NOFILE, (used + 8, used + 8))
        context = zmq.Context()
        sockets = [context.socket(zmq.DEALER) for _ in range(40)]
        for one in sockets:
            one.linger = 0
            one.connect(ends["control"])
        time.sleep(1)
        context.destroy(0)
        def plays():
            with contextlib.suppress(rustle.RustleError):
                return play(ends)
        samples = wait_for(plays, 60)
        missing = witness.end()
        assert missing == 0
        return f"{samples} samples rendered afterwards, {missing} missing"


class FailingAllocation:
    """Which allocation by `new` of a program started within is to fail, counted from when it is said; 0: none."""

    def __init__(self, place):
        self.file = pathlib.Path(place) / "countdown"
        self.file.write_bytes(bytes(8))
        self.library = pathlib.Path(place) / "allocation.so"
        subprocess.run(["g++", "-std=c++20", "-shared", "-fPIC", "-O1", "-o", self.library, HERE / "allocation.cpp"], check=True)

    def environment(self):
        return environment(LD_PRELOAD=self.library, RUSTLE_FAULT_NEW=self.file)

    def fail(self, number):
        with open(self.file, "r+b") as file:
            file.write(number.to_bytes(8, "little"))

    def left(self):
        return int.from_bytes(self.file.read_bytes(), "little")


FAR = 10**9  # allocations that nothing reaches


def some_of(total, count):
    """The first few numbers, and others from everywhere."""
    dice = random.Random(3)
    return [*range(1, 1 + count // 2), *(dice.randint(1, total) for _ in range(count - count // 2))]


@fault("an allocation fails while rustled starts", "it serves, or ends with status 1 and a sentence")
def allocation_at_start():
    with tempfile.TemporaryDirectory() as place:
        failing, log = FailingAllocation(place), pathlib.Path(place) / "log"
        ends = [f"--{name}=ipc://{place}/{name}" for name in ("control", "stream", "out")]

        def start(number):
            failing.fail(number)
            with failing.environment(), open(log, "w") as said:
                process = subprocess.Popen([BIN / "rustled", *ends, "--http", "off", "--device", "none"], stderr=said)
            wait_for(lambda: process.poll() is not None or "control ipc" in log.read_text(), 60)
            serves = process.poll() is None
            process.terminate()
            assert process.wait(10) == (0 if serves else 1), (number, process.returncode, log.read_text()[-500:])
            assert serves or log.read_text().startswith("rustled: ") or "] rustled: " in log.read_text(), (number, log.read_text())
            return serves
        assert start(FAR)
        total = FAR - failing.left()
        served_all = [start(number) for number in some_of(total, often(120, 12))]
        return f"{len(served_all)} of {total} allocations failed one by one: {sum(served_all)} starts served, the others ended with a sentence"


@fault("an allocation fails while a client attaches and sends", "the daemon goes on, others have no gap, the next client is served")
def allocation_at_attach():
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        failing = FailingAllocation(place)
        with failing.environment():
            ends = stack.enter_context(served())
        witness = Witness(ends)

        def attempt_with(number):
            failing.fail(number)
            try:
                with rustle.Connection.connect(ends["control"], 2) as connection:
                    session = rustle.Session.attach(connection, options(name="unlucky"), reconnect=False)
                    session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
                    for k in range(5):
                        session.frame(1, 1, k / 60, MOTION.at(k / 60))
                    session.detach()
                return True
            except rustle.RustleError:
                return False
            finally:
                failing.fail(0)
        attempt_with(FAR)
        went_well = [attempt_with(number) for number in some_of(4000, often(100, 10))]
        samples, missing = play(ends), witness.end()
        assert missing == 0
        return f"{len(went_well)} failed one by one, {sum(went_well)} clients noticed nothing; {samples} samples rendered afterwards, {missing} missing"


@fault("a sound pack is damaged, in every file", "it is left out by name or loads, others are served")
def corrupt_pack():
    packs = BUILD / "share/rustle/packs"
    dice, seen = random.Random(6), 0
    with tempfile.TemporaryDirectory() as place:
        copy = pathlib.Path(place) / "packs"
        shutil.copytree(packs, copy)
        victim = sorted(path.parent for path in copy.rglob("pack.json"))[0]
        for file in [victim / "pack.json", *sorted(path for path in victim.rglob("*") if path.is_file())[:often(12, 3)]]:
            whole = file.read_bytes()
            damaged = bytearray(whole)
            for _ in range(8):
                damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
            file.write_bytes(damaged[:len(damaged) * 3 // 4])
            with environment(RUSTLE_PACK_PATH=copy), served() as ends:
                play(ends, 0.05)
                seen += "left out" in ends["log"].read_text()
            file.write_bytes(whole)
        assert seen >= 1
        return f"{seen} times left out by name, each time served"


@fault("a port is in use", "status 1 and a sentence with port and flag")
def port_in_use():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = subprocess.run([BIN / "rustled", "--control", f"tcp://127.0.0.1:{port}", "--device", "none", "--http", "off"], capture_output=True,
                              text=True, timeout=20)
        assert done.returncode == 1 and f"port {port} is in use" in done.stderr and "--control" in done.stderr, done
        return done.stderr.strip().splitlines()[-1][:90]


def ended_at_a_moment(signal_number, moments):
    dice, longest = random.Random(7), 0
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        ends = {name: f"ipc://{folder}/{name}" for name in ("control", "stream", "out")}
        for k in range(moments):
            process = subprocess.Popen([BIN / "rustled", *(f"--{k}={v}" for k, v in ends.items()), "--http", "off", "--device", "none",
                                        "--recordings", folder / "takes", "--record-all"], stderr=open(folder / "log", "w"))
            begun, after = time.monotonic(), dice.random() * 1.2
            worker = threading.Thread(target=attempt, args=(ends,), daemon=True)
            worker.start()
            time.sleep(max(0, begun + after - time.monotonic()))
            begun = time.monotonic()
            process.send_signal(signal_number)
            status = process.wait(15)
            longest = max(longest, time.monotonic() - begun)
            caught = signal_number == signal.SIGTERM and (folder / "log").read_text() != ""
            assert status in ((0,) if caught else (0, -signal_number)), (k, status)
            worker.join(20)
            assert not worker.is_alive()
        for file in (folder / "takes").glob("*.mcap"):
            done = subprocess.run([BIN / "rustle", "render", file, "-o", folder / "x.wav"], capture_output=True, text=True, timeout=60)
            assert done.returncode in (0, 1) and "terminate" not in done.stderr, done
    with served() as ends:
        play(ends)
    return longest


def attempt(ends):
    """A client that takes what comes."""
    with contextlib.suppress(rustle.RustleError):
        connection = rustle.Connection.connect(ends["control"], 2)
        session = rustle.Session.attach(connection, options(LIVE, name="x"), reconnect=False)
        session.add_topology(1, MOTION.triangles, material_coordinates=MOTION.material)
        for k in range(60):
            session.frame(1, 1, k / 60, MOTION.at(k / 60))
            time.sleep(1 / 60)
        session.detach()


@fault("SIGTERM at any moment", "status 0 within 5 s, once it has said a word")
def sigterm():
    longest = ended_at_a_moment(signal.SIGTERM, often(60, 6))
    assert longest < 5
    return f"{often(60, 6)} moments, {longest:.2f} s at most"


@fault("SIGKILL at any moment", "the next start serves, recordings are read as far as they go")
def sigkill():
    ended_at_a_moment(signal.SIGKILL, often(60, 6))
    return f"{often(60, 6)} moments, each start afterwards served"


# ----------------------------------------------------------------------------------------------------------- captures

def captures(what, number):
    done = subprocess.run([BUILD / "tests/fault_captures", what, str(number)], capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout.strip()


@fault("a capture is cut at every byte", "every record of every whole chunk before, no wrong one")
def capture_cut():
    return captures("cuts", STORED_CAPTURE)


@fault("a capture is flipped at every bit", "told; every record of every whole chunk before, no wrong one")
def capture_flipped():
    return captures("some-flips" if QUICK else "flips", often(60, 12))


@fault("the writer is killed while it records", "no acknowledged record lost, none invented")
def capture_killed():
    return captures("kills", often(1000, 50))


@fault("a write or sync fails while it records", "told, no false acknowledgement, no sync tried again")
def capture_failed():
    return captures("errors", often(400, 100))


def main():
    global QUICK
    names = [name for name in sys.argv[1:] if not name.startswith("-")]
    QUICK = "--quick" in sys.argv
    unknown = set(names) - {row[0] for row in TABLE}
    if unknown or "--help" in sys.argv:
        print(__doc__ + "names: " + ", ".join(row[0] for row in TABLE))
        return 2 if unknown else 0
    broken = 0
    for name, injected, expected, inject in TABLE:
        if names and name not in names:
            continue
        begun = time.monotonic()
        try:
            seen, holds = inject(), True
        except Exception as error:  # a fault that does not hold is a line as well
            seen, holds = f"{type(error).__name__}: {error}", False
        broken += not holds
        print(f"{'holds' if holds else 'BROKEN':<7} {name}: {injected} | {expected} | {seen} ({time.monotonic() - begun:.0f} s)", flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
