"""Faults of the machine: clocks, disks, descriptors, memory, ports, signals."""
import contextlib
import os
import pathlib
import random
import resource
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time

import zmq

from running import BIN, BUILD, HERE, LIVE, MOTION, Witness, play, served, served_by_tcp, status_of, wait_for
from table import fault, often
import rustle
from python_sdk_test import options


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
