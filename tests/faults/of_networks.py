"""Faults of the network between client and daemon."""
import contextlib
import os
import pathlib
import subprocess
import tempfile
import time

import numpy as np

from running import BIN, LIVE, MOTION, served, wait_for
from table import fault
import rustle
from network import Wire, enter
from python_sdk_test import options


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
