"""Faults of clients: simulators and listeners that vanish, stop, or send nonsense."""
import contextlib
import random
import signal
import socket
import time

import zmq

from running import LIVE, MOTION, Witness, client, play, served, served_by_tcp, status_of, wait_for
from table import fault, often
import rustle
from python_sdk_test import options
from rustle.v1 import session_pb2


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
