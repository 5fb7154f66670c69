"""A rustled that faults are injected into: served, watched, and heard."""
import contextlib
import inspect
import pathlib
import re
import subprocess
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "e2e"))
# Whoever imports this first finds these, too.
from support import BIN, BUILD, STORED_CAPTURE, daemon

sys.path.insert(0, str(BUILD / "python"))
import rustle
from python_sdk_test import Motion, options

LIVE, SIMULATION = rustle.Clock.LIVE, rustle.Clock.SIMULATION
MOTION = Motion()


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


def play(ends, seconds=0.2):
    """A whole simulation: the daemon serves."""
    with rustle.Connection.connect(ends["control"]) as connection, rustle.Session.attach(connection, options()) as session:
        with session.listen() as reader:
            MOTION.play(session, seconds)
            return len(reader.read_all().samples)


CLIENT = """
import sys; sys.path[:0] = {paths!r}
from running import *
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
