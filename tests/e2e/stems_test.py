#!/usr/bin/python3
"""Sound beside the mix: stems that add up to it, emitters that make it, offline and over the wire, and listeners that do not read."""
import contextlib
import json
import subprocess
import sys
import time
import unittest

import numpy as np

from support import BIN, BUILD, STORED_CAPTURE, RustleTest, bent, curvature_of, daemon, grid, main, read_wav, rms_dbfs, rustle, table

sys.path.insert(0, str(BUILD / "python"))
import rustle as sdk

SIMULATION = sdk.Clock.SIMULATION
KINDS = ("crumpling", "friction")


def two_sheets(**more):
    return sdk.SessionOptions(name="two", clock=SIMULATION, sheets=[sdk.SheetOptions(1), sdk.SheetOptions(7)], **more)


def play(session, seconds):
    """One sheet flaps and slides over a table, another flaps above it."""
    material, triangles = grid(0.2, 0.1, 10, 5)
    curvature = curvature_of(0.2, 0.1)
    arrays = table()
    session.scene(0, obstacles=[sdk.Obstacle(1, sdk.Mesh(arrays["obstacle0_triangles"], arrays["obstacle0_vertices"]))])
    session.add_topology(1, triangles, material_coordinates=material)
    for t in np.arange(round(seconds * 60)) / 60:
        low = bent(material, curvature * np.sin(2 * np.pi * 4 * t)) + [0.2 * t, 0, 0.001]
        high = bent(material, curvature * np.cos(2 * np.pi * 3 * t)) + [0, 0.3, 0.3]
        session.frame(1, 1, t, low.astype(np.float32))
        session.frame(7, 1, t, high.astype(np.float32))
    session.end()


@contextlib.contextmanager
def live_replay(ends):
    """The stored capture, again and again, as a session that has begun."""
    replay = subprocess.Popen([BIN / "rustle", "replay", STORED_CAPTURE, "--loop", "0", "--control", ends["control"]],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with sdk.Connection.connect(ends["control"], 20) as connection:
            deadline = time.monotonic() + 20
            while not any(session.newest_time_s > 0 for session in connection.list_sessions()):
                if time.monotonic() > deadline:
                    raise AssertionError("the replay did not begin")
                time.sleep(0.02)
        yield
    finally:
        replay.terminate()
        replay.wait(10)


class Stems(RustleTest):
    def assert_sum(self, mix, stems):
        """Sample for sample; added in the order of sheets and kinds as the daemon does, bit for bit."""
        total = np.zeros_like(mix)
        for stem in stems:
            self.assertEqual(stem.shape, mix.shape)
            total = total + stem
        np.testing.assert_array_equal(total, mix)

    def test_rendered_stems_add_up_to_the_mix(self):
        folder = self.folder / "stems"
        rustle("render", STORED_CAPTURE, "-o", self.folder / "mix.wav", "--stems", folder)
        rate, mix = read_wav(self.folder / "mix.wav")
        stems = {path.stem: read_wav(path)[1] for path in sorted(folder.glob("*.wav"))}
        self.assertGreater(len(stems), 0)
        rustle("render", STORED_CAPTURE, "-o", self.folder / "alone.wav")
        np.testing.assert_array_equal(read_wav(self.folder / "alone.wav")[1], mix)
        self.assertLess(np.abs(mix).max(), 0.7, "the limiter does not act")
        self.assertGreater(np.abs(mix).max(), 1e-3)
        self.assert_sum(mix.astype(np.float32), [stem.astype(np.float32) for stem in stems.values()])

    def test_streamed_stems_add_up_to_the_mix(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, two_sheets()) as session:
                mix = session.listen()
                stems = {(sheet, kind): session.listen(stem=(sheet, kind)) for sheet in (1, 7) for kind in KINDS}
                sixteen = session.listen(sdk.ListenOptions(blocks=1), stem=(1, "friction"), format="s16")
                unknown = session.listen(stem=(3, sdk.SoundKind.TEARING))
                play(session, 1.5)
                mix = mix.read_all()
                sounds = {key: reader.read_all() for key, reader in stems.items()}
                silence, coarse = unknown.read_all(), sixteen.read_all()
                self.assertEqual(session.statistics().samples_limited, 0)
            with sdk.Session.attach(connection, two_sheets()) as session:
                alone = session.listen()
                play(session, 1.5)
                np.testing.assert_array_equal(alone.read_all().samples, mix.samples)
        for sound in [*sounds.values(), silence, coarse]:
            self.assertEqual((sound.first_sample, sound.gaps), (0, ()))
        for key in ((1, "crumpling"), (1, "friction"), (7, "crumpling")):
            self.assertGreater(np.abs(sounds[key].samples).max(), 1e-4, key)
        self.assertEqual(np.abs(silence.samples).max(), 0)
        self.assertLess(np.abs(coarse.samples - sounds[1, "friction"].samples).max(), 0.51 / 32767)
        self.assert_sum(mix.samples, [sound.samples for sound in sounds.values()])

    def test_a_stem_that_is_listened_to_later_is_in_step(self):
        live = sdk.SessionOptions(name="live", sheets=[sdk.SheetOptions(1)])
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, live) as session:
                mix = session.listen()
                first = mix.next(5)
                stem = session.listen(stem=(1, "friction"))
                began = stem.next(5)
                self.assertGreater(began.first_sample, first.first_sample)
                self.assertAlmostEqual(began.time_s - first.time_s, (began.first_sample - first.first_sample) / 48000, delta=1e-6)
                self.assertEqual(began.first_sample % 64, 0)
                following = stem.next(5)
                self.assertEqual(following.first_sample, began.first_sample + len(began.samples))
                stem.close()
                session.listen(stem=(1, "friction")).next(5)  # another listener of the same

    def test_kinds_that_are_not_are_named(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, two_sheets()) as session:
                with self.assertRaises(sdk.InvalidArgument) as caught:
                    session.listen(stem=(1, "whistling"))
                self.assertEqual(caught.exception.field, "stem")
                self.assertIn("friction", str(caught.exception))
            done = rustle("listen", "two", "--stem", "1/whistling", "--control", ends["control"], status=2)
            self.assertIn("1/friction", done.stderr)

    def test_more_stems_than_there_may_be_are_refused_with_a_remedy(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            notices = []
            with sdk.Session.attach(connection, two_sheets(), on_notice=notices.append) as session:
                readers = [session.listen(stem=(sheet, "friction")) for sheet in range(65)]
                play(session, 0.1)
                self.assertEqual([len(reader.read_all(20).samples) > 0 for reader in readers[:64]], 64 * [True])
                session.poll_notices()
        self.assertEqual([(notice.code, notice.field) for notice in notices], [("quota_exceeded", "topic")])
        self.assertIn("64", notices[0].message)
        self.assertTrue(notices[0].remedy)


def spatialized(emitters, listener, length):
    """The mix of a mono session without reflections from its emitters' dry sound: the dipole's gain, no delay."""
    total = np.zeros(length)
    for blocks in emitters.values():
        for block in blocks:
            way = np.subtract(listener, block.emitter.position)
            distance = np.linalg.norm(way)
            gain = abs(np.dot(way, block.emitter.normal)) / distance / distance
            total[block.first_sample:block.first_sample + len(block.samples)] += gain * block.samples[:, 0]
    return total


class Emitters(RustleTest):
    LISTENER = (0.1, 0.0, 1.5)

    def listen(self, ends, **how):
        """(mix, blocks by emitter, the reader) of a sheet that flaps and slides below the listener."""
        with sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, two_sheets(channels=sdk.Channels.MONO)) as session:
                session.listener(0, self.LISTENER)
                mix, dry = session.listen(), session.listen(emitters=True, **how)
                play(session, 1.5)
                emitters = {}
                for block in dry:
                    emitters.setdefault(block.emitter.emitter_id, []).append(block)
                statistics = session.statistics()
                self.assertEqual((statistics.emitter_samples_left_out, statistics.samples_limited), (0, 0))
                return mix.read_all().samples[:, 0], emitters, dry

    def test_emitters_spatialized_anew_are_the_mix(self):
        with daemon(self.folder, "--device", "none") as ends:
            mix, emitters, reader = self.listen(ends)
        self.assertEqual((reader.missing_samples, reader.missing_messages), (0, 0))
        kinds = {blocks[0].emitter.kind for blocks in emitters.values()}
        self.assertEqual(kinds, {sdk.SoundKind.CRUMPLING, sdk.SoundKind.FRICTION})
        self.assertEqual({blocks[0].emitter.sheet_id for blocks in emitters.values()}, {1, 7})
        for blocks in emitters.values():
            self.assertTrue(blocks[-1].emitter.last)
            for before, after in zip(blocks, blocks[1:]):
                if not before.emitter.last:
                    self.assertEqual(after.first_sample, before.first_sample + len(before.samples))
                self.assertEqual(after.emitter.kind, before.emitter.kind)
            positions = np.array([block.emitter.position for block in blocks])
            self.assertLess(np.abs(positions).max(), 1)
            np.testing.assert_allclose(np.linalg.norm([block.emitter.normal for block in blocks], axis=1), 1, atol=1e-3)
        again = spatialized(emitters, self.LISTENER, len(mix))
        self.assertGreater(np.corrcoef(again, mix)[0, 1], 0.99)
        self.assertAlmostEqual(rms_dbfs(again) - rms_dbfs(mix), 0, delta=0.3)

    def test_rendered_emitters_leave_the_mix_alone(self):
        folder = self.folder / "emitters"
        done = rustle("render", STORED_CAPTURE, "-o", self.folder / "mix.wav", "--emitters", folder, "--json")
        rustle("render", STORED_CAPTURE, "-o", self.folder / "alone.wav")
        np.testing.assert_array_equal(read_wav(self.folder / "alone.wav")[1], read_wav(self.folder / "mix.wav")[1])
        rendered = self.read_folder(folder)
        self.assertGreater(len(rendered), 3)
        self.assertEqual(json.loads(done.stdout)["emitters"], len(rendered))

    def test_a_live_session_is_heard_emitter_by_emitter(self):
        folder = self.folder / "emitters"
        with daemon(self.folder, "--device", "none") as ends:
            with live_replay(ends):
                done = rustle("listen", "--emitters", folder, "--control", ends["control"], "--seconds", 2)
        heard = self.read_folder(folder)
        self.assertIn(f"{len(heard)} emitters", done.stdout)
        self.assertGreater(max(np.abs(sound).max() for sound, _ in heard.values()), 1e-3)
        for sound, lines in heard.values():
            self.assertEqual(lines[-1]["sample"] - lines[0]["sample"], len(sound))

    def read_folder(self, folder):
        """By emitter and first sample: (sound, lines)."""
        lines = [json.loads(line) for line in (folder / "emitters.jsonl").read_text().splitlines()]
        files = {}
        for line in lines:
            files.setdefault(line["file"], []).append(line)
        self.assertEqual(sorted(files), sorted(path.name for path in folder.glob("*.wav")))
        found = {}
        for name, own in files.items():
            self.assertEqual([line["last"] for line in own], [False] * (len(own) - 1) + [True])
            found[own[0]["emitter"], own[0]["sample"]] = (read_wav(folder / name)[1], own)
        return found


class Opus(RustleTest):
    def assert_alike(self, opus, plain):
        """In the same place: no lag fits better than none, and what is left over is the codec's noise."""
        self.assertEqual(opus.shape, plain.shape)
        fits = {lag: np.corrcoef(np.roll(opus, -lag), plain)[0, 1] for lag in (-2, -1, 0, 1, 2)}
        self.assertEqual(max(fits, key=fits.get), 0, fits)
        self.assertGreater(fits[0], 0.9)

    def test_mix_stem_and_emitters_come_as_packets_in_the_same_places(self):
        mono = two_sheets(channels=sdk.Channels.MONO)
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, mono) as session:
                readers = {format: (session.listen(format=format), session.listen(stem=(1, "crumpling"), format=format),
                                    session.listen(emitters=True, format=format)) for format in ("f32", "opus")}
                play(session, 1.5)
                sounds, emitters = {}, {}
                for format, (mix, stem, dry) in readers.items():
                    sounds[format] = [mix.read_all(), stem.read_all()]
                    emitters[format] = self.by_emitter(dry)
                    self.assertEqual((mix.missing_messages, mix.unreadable_messages, dry.missing_samples, dry.unreadable_messages), (0, 0, 0, 0))
        for opus, plain in zip(sounds["opus"], sounds["f32"]):
            self.assertEqual((opus.first_sample, opus.gaps, opus.rate_hz), (0, (), 48000))
            self.assert_alike(opus.samples[:, 0], plain.samples[:, 0])
        self.assertEqual(emitters["opus"].keys(), emitters["f32"].keys())
        for key, (sound, where) in emitters["f32"].items():
            self.assertEqual((len(emitters["opus"][key][0]), emitters["opus"][key][1]), (len(sound), where))
        longest = max(emitters["f32"], key=lambda key: len(emitters["f32"][key][0]))
        self.assert_alike(emitters["opus"][longest][0], emitters["f32"][longest][0])

    def by_emitter(self, dry):
        """By emitter and first sample: its sound, and where it began."""
        found, going_on = {}, {}
        for block in dry:
            state = block.emitter
            key = going_on.setdefault(state.emitter_id, (state.emitter_id, block.first_sample))
            found.setdefault(key, ([], state.position))[0].append(block.samples[:, 0])
            if state.last:
                del going_on[state.emitter_id]
        self.assertEqual(going_on, {})
        return {key: (np.concatenate(parts), where) for key, (parts, where) in found.items()}

    def test_rates_that_opus_has_not_are_refused_with_a_remedy(self):
        notices = []
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            without_sheets = sdk.SessionOptions(name="empty", clock=SIMULATION, rate_hz=44100)
            with sdk.Session.attach(connection, without_sheets, on_notice=notices.append) as session:
                session.listen(format="opus")
                deadline = time.monotonic() + 10
                while not notices and time.monotonic() < deadline:
                    session.poll_notices()
                    time.sleep(0.01)
        self.assertEqual([(notice.code, notice.field) for notice in notices], [("unsupported", "topic")])
        self.assertIn("44100", notices[0].message)
        self.assertIn("48000", notices[0].remedy)

    def test_listeners_share_a_stream_of_packets(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, two_sheets()) as session:
                one, other = session.listen(sdk.ListenOptions(blocks=1), format="opus"), session.listen(format="opus")
                play(session, 0.5)
                np.testing.assert_array_equal(one.read_all().samples, other.read_all().samples)

    def test_without_libopus_the_package_is_named(self):
        code = ("import ctypes, sys\nsys.path.insert(0, sys.argv[1])\nload = ctypes.CDLL\n"
                "ctypes.CDLL = lambda name, *more: load('libnothing.so.0' if 'opus' in name else name, *more)\n"
                "import rustle.opus\ntry: rustle.opus.library()\nexcept rustle.RustleError as error: print(error)\n")
        done = subprocess.run([sys.executable, "-c", code, str(BUILD / "python")], capture_output=True, text=True, check=True)
        self.assertIn("apt install libopus0", done.stdout)

    def test_listening_to_packets_writes_a_file(self):
        wav = self.folder / "heard.wav"
        with daemon(self.folder, "--device", "none") as ends:
            with live_replay(ends):
                rustle("listen", "--format", "opus", "-o", wav, "--control", ends["control"], "--seconds", 2)
        rate, samples = read_wav(wav)
        self.assertGreaterEqual(len(samples), 2 * rate)
        self.assertGreater(np.abs(samples).max(), 1e-3)


class SlowListeners(RustleTest):
    def test_one_that_does_not_read_loses_only_its_own_messages(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, two_sheets(block_size=64)) as session:
                stem, narrow = (1, "friction"), sdk.ListenOptions(blocks=1, queue_messages=10)
                slow = {"stem": session.listen(narrow, stem=stem), "mix": session.listen(narrow)}
                quick = session.listen(sdk.ListenOptions(blocks=1), stem=stem)
                for second in range(1, 61):  # no faster than the quick one reads
                    session.advance(second)
                    while quick.next(10).time_s < second - 0.1:
                        pass
                time.sleep(1)  # longer than any heartbeat's patience
                received = {name: sum(len(block.samples) for block in iter(lambda: reader.next(0.5), None))
                            for name, reader in slow.items()}
                session.end(61)
                while not quick.next(10).end:
                    pass
                self.assertEqual(quick.missing_samples, 0)
                for name, reader in slow.items():
                    rest = list(reader)
                    self.assertGreater(rest[0].missing_samples, 48000, "the gap is marked where it is")
                    self.assertTrue(all(block.missing_samples == 0 for block in rest[1:]))
                    self.assertEqual(reader.missing_samples, rest[0].missing_samples)
                    self.assertEqual(received[name] + reader.missing_samples + sum(len(block.samples) for block in rest), 61 * 48000)
                statistics = session.statistics()
                self.assertEqual((statistics.samples_sent, statistics.samples_in_gaps), (61 * 48000, 0))


if __name__ == "__main__":
    main()
