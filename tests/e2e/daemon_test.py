#!/usr/bin/python3
"""The daemon among several clients: recorded times kept, sound delivered, mistakes answered, nobody else disturbed."""
import json
import subprocess
import time

import numpy as np
import zmq

from publisher_test import AUDIO, SESSION
from support import BIN, STORED_CAPTURE, RustleTest, bent, daemon, grid, main, read_wav, rustle, wait_until


def session_count(ends):
    """How many sessions the daemon has, in the bare protocol."""
    context = zmq.Context()
    control = context.socket(zmq.DEALER)
    try:
        control.linger = 0
        control.connect(ends["control"])
        request = SESSION.ControlRequest(request_id=1)
        request.list_sessions.SetInParent()
        control.send(request.SerializeToString())
        assert control.poll(5000), "the daemon answers"
        return len(SESSION.ControlReply.FromString(control.recv()).session_list.sessions)
    finally:
        context.destroy()


class Client:
    """The bare protocol of a client with control."""

    def __init__(self, ends, name, clock=SESSION.CLOCK_SIMULATION):
        self.context = zmq.Context()
        self.control = self.context.socket(zmq.DEALER)
        self.stream = self.context.socket(zmq.XPUB)
        self.notices = self.context.socket(zmq.SUB)
        for socket in (self.control, self.stream, self.notices):
            socket.linger = 0
        self.control.connect(ends["control"])
        self.stream.connect(ends["stream"])
        assert self.stream.poll(5000), "the daemon subscribes"
        self.notices.connect(ends["out"])
        self.notices.subscribe(f"{name}/notices")
        self.notices.subscribe(f"{name}/pcm/mix/f32/1")
        self.name, self.sequence = name, 0
        self.reply = self.ask(attach=lambda m: setattr(m.options, "clock", clock), session_id=name)

    def ask(self, session_id=None, **request):
        message = SESSION.ControlRequest(request_id=7, session_id=session_id or self.name)
        for field, fill in request.items():
            fill(getattr(message, field))
            getattr(message, field).SetInParent()
        self.control.send(message.SerializeToString())
        assert self.control.poll(5000), "the daemon answers"
        reply = SESSION.ControlReply.FromString(self.control.recv())
        assert reply.request_id == 7
        return reply

    def send(self, **body):
        self.sequence += 1
        message = SESSION.StreamMessage(session_id=self.name, sequence=self.sequence)
        for field, fill in body.items():
            fill(getattr(message, field))
            getattr(message, field).SetInParent()
        self.stream.send_multipart([self.name.encode(), message.SerializeToString()])

    def describe(self, material, triangles):
        def topology(m):
            m.topology_id, m.vertex_count, m.triangles = 1, len(material), triangles.astype("<u4").tobytes()
            m.material_coordinates = material.astype("<f4").tobytes()
        self.send(sheet=lambda m: setattr(m, "sheet_id", 1))
        self.send(topology=topology)

    def frame(self, time_s, positions, topology=1):
        def fill(m):
            m.sheet_id, m.topology_id, m.time_s = 1, topology, time_s
            m.positions = np.asarray(positions, "<f4").tobytes()
        self.send(frame=fill)

    def heard(self, seconds):
        """(notices by code, samples) that arrive within that time."""
        notices, samples, deadline = {}, [], time.monotonic() + seconds
        while time.monotonic() < deadline:
            if self.notices.poll(50):
                message = AUDIO.OutMessage.FromString(self.notices.recv_multipart()[1])
                if message.HasField("notice"):
                    notices.setdefault(message.notice.code, message.notice)
                elif message.HasField("pcm"):
                    samples.append(np.frombuffer(message.pcm.data, "<f4"))
                elif message.HasField("end"):
                    break
        return notices, np.concatenate(samples) if samples else np.zeros(0)

    def close(self):
        self.context.destroy(linger=0)


class Sessions(RustleTest):
    def test_mistakes_are_answered_and_hurt_nobody_else(self):
        material, triangles = grid(0.1, 0.1, 6, 6)
        shape = bent(material, 2.0)
        with daemon(self.folder) as ends:
            good, bad = Client(ends, "good"), Client(ends, "bad")
            self.assertTrue(good.reply.HasField("attached") and bad.reply.HasField("attached"))
            for client in (good, bad):
                client.describe(material, triangles)
            broken = shape.copy()
            broken[5, 1] = np.nan
            mistakes = {"unknown_topology": lambda t: bad.frame(t, shape, topology=99),
                        "not_finite": lambda t: bad.frame(t, broken),
                        "malformed": lambda t: bad.frame(t, shape[:-1])}
            for number, make in enumerate(mistakes.values()):
                make(0.1 * (number + 1))
            wrong = triangles.copy()
            wrong[3, 1] = 1000
            bad.describe(material, wrong)
            bad.stream.send_multipart([b"bad", b"\xff\xfe nonsense"])
            notices, _ = bad.heard(1.5)
            for code in [*mistakes, "out_of_range"]:
                self.assertIn(code, notices)
                self.assertTrue(notices[code].field and notices[code].message and notices[code].remedy, code)
            for k in range(60):
                good.frame(k / 60, bent(material, 5 * np.cos(k / 5)))
            good.send(end=lambda m: None)
            notices, samples = good.heard(10)
            self.assertEqual(notices, {})
            self.assertGreater(np.abs(samples).max(), 1e-3)
            statistics = good.ask(get_statistics=lambda m: None).statistics
            self.assertEqual((statistics.frames_received, statistics.frames_analysed), (60, 60))
            statistics = bad.ask(get_statistics=lambda m: None).statistics
            self.assertEqual(statistics.frames_received, statistics.frames_analysed + sum(statistics.frames_dropped.values()))
            good.close(), bad.close()

    def test_control_mistakes(self):
        with daemon(self.folder) as ends:
            client = Client(ends, "one")
            self.assertEqual(client.ask(attach=lambda m: None).error.code, SESSION.ERROR_CODE_SESSION_EXISTS)
            self.assertEqual(client.ask(session_id="other", attach=lambda m: setattr(m.options, "default_material", "lead")).error.code,
                             SESSION.ERROR_CODE_UNKNOWN_MATERIAL)
            self.assertEqual(client.ask(session_id="none", detach=lambda m: None).error.code, SESSION.ERROR_CODE_UNKNOWN_SESSION)
            self.assertEqual(client.ask(hello=lambda m: setattr(m, "protocol_version", 99)).error.code, SESSION.ERROR_CODE_PROTOCOL_VERSION)
            self.assertTrue(client.ask(list_packs=lambda m: None).pack_list.packs)
            client.control.send(b"\x00\x01 nonsense")
            self.assertTrue(client.control.poll(5000))
            client.close()


class Replay(RustleTest):
    def test_live_keeps_the_recorded_times(self):
        with daemon(self.folder) as ends:
            done = rustle("replay", STORED_CAPTURE, "--clock", "live", "--loop", 2, "--control", ends["control"], "--json")
            figures = json.loads(done.stdout)
            self.assertEqual(figures["frames_received"], figures["frames"])
            self.assertEqual(figures["frames_received"], figures["frames_analysed"] + sum(figures["frames_dropped"].values()))
            self.assertLess(figures["median_timing_error_s"], 0.002)

    def test_listening_to_a_live_replay(self):
        wav = self.folder / "heard.wav"
        with daemon(self.folder) as ends:
            replay = subprocess.Popen([BIN / "rustle", "replay", STORED_CAPTURE, "--loop", "0", "--control", ends["control"]],
                                      stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            try:
                wait_until(lambda: session_count(ends) == 1, 20, "the replay did not attach")
                rustle("listen", "--control", ends["control"], "-o", wav, "--seconds", 3)
            finally:
                replay.terminate()
                replay.wait(10)
        rate, samples = read_wav(wav)
        self.assertGreaterEqual(len(samples), 3 * rate)
        self.assertGreater(np.abs(samples).max(), 1e-3)

    def test_a_killed_daemon_is_noticed_and_named(self):
        for clock in ("simulation", "live"):
            folder = self.folder / clock
            folder.mkdir()
            with self.subTest(clock=clock), daemon(folder) as ends:
                wav = self.folder / f"{clock}.wav"
                replay = subprocess.Popen([BIN / "rustle", "replay", STORED_CAPTURE, "--loop", "0", "--clock", clock, "--wav", wav,
                                           "--control", ends["control"]], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
                try:
                    wait_until(lambda: session_count(ends) == 1, 20, "the replay did not attach")
                    self.assertIsNone(replay.poll())
                    ends["process"].kill()
                    complaint = replay.communicate(timeout=8)[1]  # 2 s, and what a busy machine takes
                finally:
                    replay.kill()
                self.assertEqual(replay.returncode, 1)
                self.assertIn(ends["control"], complaint)
                self.assertIn("start it again", complaint)
                self.assertNotIn("set_send_timeout", complaint)

    def test_figures_are_told_by_replay_and_render(self):
        losses = ["voices_most", "voices_stolen", "voices_dropped", "sources_dropped", "cues_dropped", "sounds_missing",
                  "planes_left_out", "samples_limited", "samples_not_finite", "voices_merged"]
        wav, rendered = self.folder / "replayed.wav", self.folder / "rendered.wav"
        with daemon(self.folder) as ends:
            done = rustle("replay", STORED_CAPTURE, "--clock", "simulation", "--control", ends["control"], "--json", "--wav", wav)
        replayed = json.loads(done.stdout)
        offline = json.loads(rustle("render", STORED_CAPTURE, "-o", rendered, "--json").stdout)
        self.assertEqual({name: replayed[name] for name in losses}, {name: offline[name] for name in losses})
        self.assertGreater(replayed["voices_most"], 0)
        samples = len(read_wav(wav)[1])
        self.assertEqual((replayed["samples_due"], replayed["samples_sent"], replayed["samples_in_gaps"]), (samples, samples, 0))
        self.assertEqual(offline["samples"], samples)
        for name in ("messages_received", "rendered_time_s", "playout_delay_s", "clock_drift_ppm", "load_level", "voices",
                     "emitter_samples_left_out",
                     "frames_late", "time_jumps", "input_gaps", "samples_in_input_gaps"):
            self.assertIn(name, replayed)

    def test_a_part_of_a_capture(self):
        with daemon(self.folder) as ends:
            done = rustle("replay", STORED_CAPTURE, "--clock", "simulation", "--from", 0.5, "--to", 1.0, "--control", ends["control"], "--json")
            self.assertAlmostEqual(json.loads(done.stdout)["frames"], 15, delta=1)


if __name__ == "__main__":
    main()
