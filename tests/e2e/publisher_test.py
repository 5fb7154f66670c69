#!/usr/bin/python3
"""A simulator that only publishes: plain pyzmq and the messages of proto/rustle/v1, without an SDK and without control."""
import importlib
import subprocess
import sys
import threading
import time

import numpy as np
import zmq

from support import BUILD, SOURCE, RustleTest, bent, curvature_of, daemon, grid, main, rms_dbfs

GENERATED = BUILD / "tests/python"


def messages():
    """The generated Python modules of the wire."""
    GENERATED.mkdir(parents=True, exist_ok=True)
    protos = [str(path.relative_to(SOURCE / "proto")) for path in sorted((SOURCE / "proto/rustle/v1").glob("*.proto"))]
    subprocess.run(["protoc", f"--proto_path={SOURCE / 'proto'}", f"--python_out={GENERATED}", *protos], check=True)
    sys.path.insert(0, str(GENERATED))
    return importlib.import_module("rustle.v1.session_pb2"), importlib.import_module("rustle.v1.audio_pb2")


SESSION, AUDIO = messages()


class Publisher(threading.Thread):
    """Bends a sheet to and fro and slides it, 60 frames a second; repeats session, sheet and topology every second."""

    def __init__(self, endpoint, seconds):
        super().__init__(daemon=True)
        self.endpoint, self.seconds, self.go_on = endpoint, seconds, True

    def run(self):
        context = zmq.Context()
        socket = context.socket(zmq.PUB)
        socket.linger = 0
        socket.bind(self.endpoint)
        material, triangles = grid(0.2, 0.1, 16, 8)
        k = curvature_of(0.2, 0.1)
        sequence, start = 0, time.monotonic()

        def send(**body):
            nonlocal sequence
            sequence += 1
            message = SESSION.StreamMessage(session_id="bare", sequence=sequence)
            for name, fill in body.items():
                fill(getattr(message, name))
                getattr(message, name).SetInParent()
            socket.send_multipart([b"bare", message.SerializeToString()])

        def announce(m):
            m.protocol_version, m.name, m.options.clock = 1, "bare", SESSION.CLOCK_LIVE

        def sheet(m):
            m.sheet_id, m.name = 1, "sheet"

        def topology(m):
            m.topology_id, m.vertex_count = 1, len(material)
            m.triangles, m.material_coordinates = triangles.astype("<u4").tobytes(), material.astype("<f4").tobytes()

        next_told = 0.0
        while self.go_on and time.monotonic() - start < self.seconds:
            now = time.monotonic() - start
            if now >= next_told:
                send(announcement=announce)
                send(sheet=sheet)
                send(topology=topology)
                next_told += 1.0

            def frame(m):
                m.sheet_id, m.topology_id, m.time_s = 1, 1, now
                shape = bent(material, k * np.sin(2 * np.pi * 2 * now)) + [0, 0, 0.2]
                m.positions = shape.astype("<f4").tobytes()
            send(frame=frame)
            time.sleep(1 / 60)
        socket.close()
        context.term()


class BarePublisher(RustleTest):
    def listen(self, endpoint, seconds):
        """Samples of the session "bare" until something is heard or the time is up."""
        context = zmq.Context()
        socket = context.socket(zmq.SUB)
        socket.linger = 0
        socket.connect(endpoint)
        socket.subscribe(b"bare/pcm/mix/f32/4")
        heard, deadline = [], time.monotonic() + seconds
        while time.monotonic() < deadline:
            if not socket.poll(100):
                continue
            message = AUDIO.OutMessage.FromString(socket.recv_multipart()[1])
            if message.HasField("pcm"):
                heard.append(np.frombuffer(message.pcm.data, "<f4"))
                if sum(np.abs(block).max() > 1e-3 for block in heard if block.size) >= 3:
                    break
        socket.close()
        context.term()
        return np.concatenate(heard) if heard else np.zeros(0)

    def test_started_before_the_daemon(self):
        endpoint = f"ipc://{self.folder}/simulator"
        publisher = Publisher(endpoint, 30)
        publisher.start()
        time.sleep(1.0)
        with daemon(self.folder, "--connect", endpoint) as ends:
            self.assertGreater(rms_dbfs(self.listen(ends["out"], 15)), -80)
        publisher.go_on = False
        publisher.join()

    def test_started_after_the_daemon(self):
        endpoint = f"ipc://{self.folder}/simulator"
        with daemon(self.folder, "--connect", endpoint) as ends:
            time.sleep(0.5)
            publisher = Publisher(endpoint, 30)
            publisher.start()
            self.assertGreater(rms_dbfs(self.listen(ends["out"], 15)), -80)
            publisher.go_on = False
            publisher.join()


if __name__ == "__main__":
    main()
