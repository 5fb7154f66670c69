#!/usr/bin/python3
"""The Python SDK's readers of sound, beside a daemon that sends what it is told to: gaps, formats, emitters, another version."""
import sys
import threading

import numpy as np
import zmq

from support import BUILD, RustleTest, main

sys.path.insert(0, str(BUILD / "python"))
import rustle
from rustle.v1 import audio_pb2, session_pb2


class FakeDaemon:
    """Answers hello with a version, and publishes what it is given."""

    def __init__(self, folder, version=1):
        self.context = zmq.Context()
        self.version, self.ends = version, {name: f"ipc://{folder}/{name}" for name in ("control", "out")}
        self.control, self.out = self.context.socket(zmq.ROUTER), self.context.socket(zmq.XPUB)
        for socket, name in ((self.control, "control"), (self.out, "out")):
            socket.linger = 0
            socket.bind(self.ends[name])
        self.outgoing, self.stop = [], threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.stop.is_set():
            if self.control.poll(10):
                peer, data = self.control.recv_multipart()
                request = session_pb2.ControlRequest.FromString(data)
                reply = session_pb2.ControlReply(request_id=request.request_id)
                reply.welcome.protocol_version, reply.welcome.out_endpoint = self.version, self.ends["out"]
                self.control.send_multipart([peer, reply.SerializeToString()])
            while self.out.poll(0):
                change = self.out.recv()
                if change.startswith(b"\x01subscribed/"):
                    self.out.send_multipart([change[1:], b""])
            while self.outgoing:
                self.out.send_multipart(self.outgoing.pop(0))

    def close(self):
        self.stop.set()
        self.thread.join()
        self.context.destroy(0)

    def publish(self, topic, **body):
        self.outgoing.append([topic.encode(), audio_pb2.OutMessage(session_id="s", **body).SerializeToString()])


class Readers(RustleTest):
    def fake(self, **more):
        fake = FakeDaemon(self.folder, **more)
        self.addCleanup(fake.close)
        return fake

    def pcm(self, first, samples, format=audio_pb2.SAMPLE_FORMAT_F32, missing=0, time_s=None):
        data = np.arange(first, first + samples)[:, None] + [0.25, 0.5]
        kind = "<f4" if format == audio_pb2.SAMPLE_FORMAT_F32 else "<i2"
        return audio_pb2.Pcm(first_sample=first, rate_hz=48000, channels=2, samples=samples, format=format, data=data.astype(kind).tobytes(),
                             missing_samples=missing, time_s=first / 48000 if time_s is None else time_s)

    def test_another_version_is_named(self):
        fake = self.fake(version=2)
        with self.assertRaises(rustle.Refused) as caught:
            rustle.Connection.connect(fake.ends["control"])
        self.assertEqual(caught.exception.code_name, "protocol_version")
        self.assertIn("version 2", caught.exception.message)
        self.assertTrue(caught.exception.remedy)

    def test_gaps_are_marked_and_counted(self):
        fake = self.fake()
        topic = "s/pcm/mix/f32/1"
        with rustle.Connection.connect(fake.ends["control"]) as connection:
            listening = rustle.ListenOptions(blocks=1)
            with rustle.PcmReader.listen(connection, "s", listening) as reader, rustle.PcmReader.listen(connection, "s", listening) as again:
                for first, missing in ((100, 0), (110, 0), (140, 20), (165, 0)):  # the last gap: lost on the way, told by nobody
                    fake.publish(topic, pcm=self.pcm(first, 10, missing=missing))
                fake.publish(topic, pcm=self.pcm(175, 10, format=99))  # of a later version
                fake.publish(topic, end=audio_pb2.EndOfStream(samples=180))
                blocks = list(reader)
                self.assertEqual([(b.first_sample, b.missing_samples, b.restarted) for b in blocks],
                                 [(100, 0, False), (110, 0, False), (140, 20, False), (165, 15, False)])
                self.assertEqual((reader.missing_samples, reader.unreadable_messages), (40, 1))
                for block in blocks:
                    self.assertEqual((block.samples.dtype, block.samples.shape, block.rate_hz), (np.float32, (10, 2), 48000))
                    self.assertEqual(block.samples[3, 1], block.first_sample + 3.5)
                sound = again.read_all(10)
        self.assertEqual((sound.first_sample, len(sound.samples)), (100, 80))
        self.assertEqual([(gap.first, gap.samples) for gap in sound.gaps], [(20, 20), (50, 15), (75, 5)])
        silent = np.zeros(80, bool)
        for gap in sound.gaps:
            silent[gap.first:gap.first + gap.samples] = True
        self.assertTrue((sound.samples[silent] == 0).all())
        np.testing.assert_array_equal(sound.samples[~silent, 0], 100.25 + np.flatnonzero(~silent))

    def test_each_emitter_has_its_gaps(self):
        fake, topic = self.fake(), "s/pcm/emitter/f32/4"
        with rustle.Connection.connect(fake.ends["control"]) as connection, rustle.PcmReader.listen(connection, "s", emitters=True) as reader:
            for sequence, emitter, first, last in ((4, 1, 100, 0), (5, 2, 100, 0), (8, 1, 130, 0), (9, 2, 110, 1), (10, 2, 500, 0)):
                pcm = self.pcm(first, 10)
                pcm.emitter.emitter_id, pcm.emitter.last = emitter, bool(last)
                fake.publish(topic, sequence=sequence, pcm=pcm)
            self.assertEqual([reader.next(5).missing_samples for _ in range(5)], [0, 0, 20, 0, 0])
            self.assertEqual((reader.missing_samples, reader.missing_messages), (20, 2))
            with self.assertRaises(rustle.InvalidArgument):
                reader.read_all()

    def test_sixteen_bits_and_a_stream_that_does_not_end(self):
        fake = self.fake()
        with rustle.Connection.connect(fake.ends["control"]) as connection:
            with rustle.PcmReader.listen(connection, "s", rustle.ListenOptions(format=rustle.SampleFormat.S16, blocks=2)) as reader:
                fake.publish("s/pcm/mix/s16/2", pcm=self.pcm(0, 4, format=audio_pb2.SAMPLE_FORMAT_S16))
                block = reader.next(5)
                np.testing.assert_array_equal(block.samples[:, 0], np.arange(4, dtype=np.float32) / np.float32(32767))
                self.assertIsNone(reader.next(0.05))
                with self.assertRaises(rustle.TimedOut):
                    reader.read_all(0.1)


if __name__ == "__main__":
    main()
