#!/usr/bin/python3
"""What is changed while sessions sound: gains, packs, packs that are read from disk anew. By the SDK, by hand and offline."""
import contextlib
import json
import math
import os
import shutil
import sys
import time
import unittest.mock

import numpy as np

from playback_test import live_sound
from support import BUILD, RustleTest, bent, daemon, grid, main, read_wav, rms_dbfs, rustle, save_npz, table

sys.path.insert(0, str(BUILD / "python"))
import rustle as sdk
from rustle.v1 import session_pb2

RATE = 48000
SILENCE_DB = -math.inf
PACKS = BUILD / "share/rustle/packs"


def level(samples, begin_s, end_s):
    return rms_dbfs(samples[round(begin_s * RATE):round(end_s * RATE)])


class Slide:
    """A flat sheet that slides over a table at one speed: friction and nothing else."""

    def __init__(self):
        self.material, self.triangles = grid(0.2, 0.2, 8, 8)

    def at(self, t):
        return (bent(self.material, 0.5) + [0.1 * t, 0, 0.001]).astype(np.float32)

    def heard(self, connection, change=None, sheets=(1,), name="slide"):
        """Three seconds; after half of them `change(session)` is called once everything before has been taken."""
        options = sdk.SessionOptions(name=name, clock=sdk.Clock.SIMULATION, sheets=[sdk.SheetOptions(sheet) for sheet in sheets])
        with sdk.Session.attach(connection, options, on_notice=sdk.raise_notice) as session:
            reader = session.listen()
            session.scene(0, obstacles=[sdk.Obstacle(1, sdk.Plane())])
            session.add_topology(1, self.triangles, material_coordinates=self.material)
            for k in range(180):
                if k == 90 and change is not None:
                    session.drain()
                    change(session)
                for sheet in sheets:
                    session.frame(sheet, 1, k / 60, self.at(k / 60) + np.float32([0, 0.5 * sheet, 0]))
            session.end()
            return reader.read_all(30).samples


class Gains(RustleTest):
    def test_levels_fall_by_what_was_asked_and_by_nothing_before(self):
        slide = Slide()
        answers = []
        gains = [sdk.Gain(-6), sdk.Gain(-3, sheet_id=1), sdk.Gain(+2, kind=sdk.SoundKind.FRICTION),
                 sdk.Gain(-5, material="printer-paper"), sdk.Gain(-20, material="banknote"), sdk.Gain(-20, kind=sdk.SoundKind.CRUMPLING)]
        with daemon(self.folder) as ends, sdk.Connection.connect(ends["control"]) as connection:
            plain = slide.heard(connection)
            turned = slide.heard(connection, lambda session: answers.append(session.set_gains(gains)))
            silent = slide.heard(connection, lambda session: session.set_gains([sdk.Gain(SILENCE_DB, kind=sdk.SoundKind.FRICTION)]))

            def to_and_fro(session):
                session.set_gains(gains)
                answers.append(session.set_gains([sdk.Gain(0, material=gain.material, sheet_id=gain.sheet_id, kind=gain.kind)
                                                  for gain in gains[1:]] + [sdk.Gain(-1)]))
                answers.append(session.set_gains())
            back = slide.heard(connection, to_and_fro)
        self.assertEqual(answers, [gains, [sdk.Gain(-1)], [sdk.Gain(-1)]])
        self.assertGreater(level(plain, 1.6, 2.9), -60)
        before = round((89 / 60 - 0.05 - 0.002) * RATE)
        for changed, gain_db in ((turned, -12), (back, -1)):
            np.testing.assert_array_equal(changed[:before], plain[:before])
            self.assertAlmostEqual(level(changed, 1.5, 2.9) - level(plain, 1.5, 2.9), gain_db, delta=0.1)
        np.testing.assert_array_equal(silent[:before], plain[:before])
        self.assertEqual(np.abs(silent[round(1.5 * RATE):]).max(), 0)

    def test_sheets_are_told_apart(self):
        slide = Slide()
        with daemon(self.folder) as ends, sdk.Connection.connect(ends["control"]) as connection:
            both = slide.heard(connection, sheets=(1, 2))
            first = slide.heard(connection, lambda session: session.set_gains([sdk.Gain(SILENCE_DB, sheet_id=2)]), sheets=(1, 2))
            none = slide.heard(connection, lambda session: session.set_gains([sdk.Gain(SILENCE_DB, sheet_id=2), sdk.Gain(SILENCE_DB, sheet_id=1)]),
                               sheets=(1, 2))
        with_db, without_db = level(both, 1.6, 2.9), level(first, 1.6, 2.9)
        self.assertLess(without_db, with_db - 0.3)
        self.assertGreater(without_db, with_db - 6)
        self.assertEqual(np.abs(none[round(1.5 * RATE):]).max(), 0)

    def test_mistakes_name_field_and_remedy_and_change_nothing(self):
        with daemon(self.folder) as ends, sdk.Connection.connect(ends["control"]) as connection:
            with sdk.Session.attach(connection, sdk.SessionOptions(name="s", sheets=[sdk.SheetOptions(1)])) as session:

                def ask(fill):
                    """As a client that checks nothing by itself."""
                    request = session_pb2.ControlRequest(session_id=session.id)
                    request.set_gains.SetInParent()
                    fill(request.set_gains.gains)
                    return connection.link.ask(request).gains_set.gains
                self.assertEqual(len(session.set_gains([sdk.Gain(-6, sheet_id=1)])), 1)
                mistakes = [("unknown_sheet", "sheet_id", dict(gain_db=-6, sheet_id=7), "There are: 1"),
                            ("unknown_material", "material", dict(gain_db=-6, material="lead"), "banknote"),
                            ("not_finite", "gain_db", dict(gain_db=math.nan), "finite"),
                            ("out_of_range", "gain_db", dict(gain_db=24.5), "range")]
                for code, field, gain, remedy in mistakes:
                    with self.assertRaises(sdk.Refused) as refused:
                        ask(lambda gains: gains.add(**gain))
                    self.assertEqual((refused.exception.code_name, refused.exception.field), (code, f"set_gains.gains[0].{field}"))
                    self.assertIn(remedy, refused.exception.remedy)
                with self.assertRaises(sdk.InvalidArgument):
                    session.set_gains([sdk.Gain(math.nan)])
                with self.assertRaises(sdk.SessionLost):
                    connection.set_gains("none", [])
                self.assertEqual(session.set_gains(), [sdk.Gain(-6, sheet_id=1)])

                def many(gains):
                    for k in range(1024):
                        gains.add(gain_db=-1e-3 * (k + 1), kind=1 + k % 3, material="banknote", sheet_id=1)
                self.assertEqual(len(ask(many)), 4)

    def test_by_hand_while_it_plays(self):
        heard = self.folder / "heard.wav"

        def listen(seconds):
            rustle("listen", "--control", ends["control"], "-o", heard, "--seconds", seconds)
            return read_wav(heard)[1]
        with daemon(self.folder) as ends, live_sound(ends):
            control = ("--control", ends["control"])
            self.assertGreater(np.abs(listen(2)).max(), 1e-3)
            self.assertIn("all at 0 dB", rustle("gain", *control).stdout)
            told = json.loads(rustle("gain", "all=-inf", "friction=-6", "sheet:1=+2", *control, "--json").stdout)
            self.assertEqual([gain["gain"] for gain in told["gains"]], ["all=-inf", "friction=-6", "sheet:1=+2"])
            self.assertEqual(told["gains"][0]["gain_db"], None)
            self.assertEqual((told["gains"][1]["kind"], told["gains"][2]["sheet_id"]), ("friction", 1))
            time.sleep(0.3)
            self.assertEqual(np.abs(listen(1)).max(), 0)
            self.assertIn(": friction=-1\n", rustle("gain", "--reset", "friction=-1", *control).stdout)
            self.assertGreater(np.abs(listen(2)).max(), 1e-3)
            self.assertIn("unknown_sheet", rustle("gain", "sheet:9=-1", *control, status=1).stderr)
            self.assertIn('there is no session "x"', rustle("gain", "--session", "x", *control, status=2).stderr)
            self.assertIn('"loud=1" is no gain', rustle("gain", "loud=1", *control, status=2).stderr)

    def test_offline(self):
        slide = Slide()
        frames = [slide.at(k / 60) for k in range(90)]
        capture = self.import_npz(save_npz(self.folder / "slide.npz", frames, slide.triangles, np.arange(90) / 60, **table()))
        _, plain, _ = self.render(capture, "plain")
        _, turned, _ = self.render(capture, "turned", "--gain", "friction=-6", "--gain", "sheet:1=-1", "--gain", "crumpling=-inf")
        self.assertAlmostEqual(rms_dbfs(turned) - rms_dbfs(plain), -7, delta=0.1)
        done = rustle("render", capture, "-o", self.folder / "x.wav", "--gain", "sheet:7=-6", "--gain", "material:lead=3", status=1)
        for complaint in ("--gain sheet:7=-6 concerns no sheet", "--gain material:lead=+3 concerns no sheet", "sheet 1 of printer-paper"):
            self.assertIn(complaint, done.stderr)
        self.assertIn('"friction" is no gain', rustle("render", capture, "-o", self.folder / "x.wav", "--gain", "friction", status=2).stderr)


class Packs(RustleTest):
    """Packs in a folder of the test's own."""

    def setUp(self):
        super().setUp()
        self.packs = self.folder / "packs"
        self.packs.mkdir()
        for name in ("printer-paper", "banknote"):
            shutil.copytree(PACKS / name, self.packs / name)
        self.slide = Slide()

    @contextlib.contextmanager
    def connected(self):
        with unittest.mock.patch.dict(os.environ, {"RUSTLE_PACK_PATH": str(self.packs)}):
            with daemon(self.folder) as ends, sdk.Connection.connect(ends["control"]) as connection:
                self.control = ends["control"]
                yield connection

    def turn_friction(self, material, gain_db):
        """In the pack on disk."""
        manifest = json.loads((self.packs / material / "pack.json").read_text())
        manifest["friction"]["gain_db"] = manifest["friction"].get("gain_db", 0) + gain_db
        (self.packs / material / "pack.json").write_text(json.dumps(manifest))

    def test_a_sheet_gets_another_pack_and_keeps_it(self):
        with self.connected() as connection:
            packs = []
            paper = self.slide.heard(connection)

            def change(session):
                packs.append(session.change_pack(1, "banknote"))
                self.assertIs(session.add_sheet(sdk.SheetOptions(1)), sdk.Sent.QUEUED)  # as bare publishers repeat it
            note = self.slide.heard(connection, change)

            def there_and_back(session):
                session.change_pack(1, "banknote")
                packs.append(session.change_pack(1, "printer-paper"))
            back = self.slide.heard(connection, there_and_back)
        self.assertEqual([pack.material for pack in packs], ["banknote", "printer-paper"])
        self.assertGreater(packs[0].spectra, 0)
        before = round((89 / 60 - 0.05 - 0.002) * RATE)
        np.testing.assert_array_equal(note[:before], paper[:before])
        self.assertAlmostEqual(level(back, 1.6, 2.9), level(paper, 1.6, 2.9), delta=0.7)
        # Its colour is the other's: high frequencies over low ones.
        def tilt(samples):
            power = np.abs(np.fft.rfft(samples[round(1.6 * RATE):round(2.9 * RATE), 0])) ** 2
            return 10 * np.log10(power[len(power) // 4:].sum() / power[:len(power) // 4].sum())
        self.assertGreater(abs(tilt(note) - tilt(paper)), 3 * abs(tilt(back) - tilt(paper)) + 0.5)

    def test_mistakes_name_field_and_remedy(self):
        with self.connected() as connection, sdk.Session.attach(connection, sdk.SessionOptions(sheets=[sdk.SheetOptions(3)])) as session:
            for change, field, code, remedy in (((3, "lead"), "change_pack.material", "unknown_material", "banknote"),
                                                ((1, "banknote"), "change_pack.sheet_id", "unknown_sheet", "There are: 3"),
                                                ((3, ""), "change_pack.material", "malformed", "material")):
                with self.assertRaises(sdk.Refused) as refused:
                    session.change_pack(*change)
                self.assertEqual((refused.exception.field, refused.exception.code_name), (field, code))
                self.assertIn(remedy, refused.exception.remedy)
            control = ("--control", self.control)
            self.assertIn("banknote on wooden-table", rustle("pack", "change", "--sheet", 3, "--material", "banknote", *control).stdout)
            told = json.loads(rustle("pack", "change", "--sheet", 3, "--material", "printer-paper", *control, "--json").stdout)
            self.assertEqual(told["pack"]["material"], "printer-paper")
            self.assertIn("lead", rustle("pack", "change", "--sheet", 3, "--material", "lead", *control, status=1).stderr)
            rustle("pack", "change", *control, status=2)

    def test_packs_are_read_anew_while_they_sound(self):
        with self.connected() as connection:
            before = self.slide.heard(connection)

            def reload(session):
                self.turn_friction("printer-paper", -12)
                for name in ("printer-paper", "printer-paper-on-wooden-table"):
                    self.assertEqual([pack.material for pack in connection.reload_pack(name)], ["printer-paper"])
            turned = self.slide.heard(connection, reload)
            after = self.slide.heard(connection)
            self.turn_friction("printer-paper", 3)
            said = json.loads(rustle("pack", "reload", "--control", self.control, "--json").stdout)
            self.assertEqual(sorted(pack["material"] for pack in said), ["banknote", "corduroy", "cotton", "polyester", "printer-paper", "tracing-paper", "windbreaker"])
            louder = self.slide.heard(connection)
        same = round((89 / 60 - 0.05 - 0.002) * RATE)
        np.testing.assert_array_equal(turned[:same], before[:same])
        self.assertAlmostEqual(level(turned, 1.6, 2.9) - level(before, 1.6, 2.9), -12, delta=0.7)
        self.assertAlmostEqual(level(after, 0.5, 2.9) - level(before, 0.5, 2.9), -12, delta=0.1)
        self.assertAlmostEqual(level(louder, 0.5, 2.9) - level(before, 0.5, 2.9), -9, delta=0.1)

    def test_a_broken_pack_leaves_the_old_one_in_force(self):
        spectrum = next((self.packs / "printer-paper").rglob("*.npy"))
        with self.connected() as connection:
            before, known = self.slide.heard(connection), connection.list_packs()

            def break_it(session):
                self.turn_friction("banknote", -20)
                spectrum.write_bytes(spectrum.read_bytes()[:100])
                for name in ("printer-paper", ""):
                    with self.assertRaises(sdk.Refused) as refused:
                        connection.reload_pack(name)
                    self.assertIn(str(spectrum), str(refused.exception))
                    self.assertIn("stay as they were", str(refused.exception))
            while_broken = self.slide.heard(connection, break_it)
            after = self.slide.heard(connection)
            self.assertIn(str(spectrum), rustle("pack", "reload", "printer-paper", "--control", self.control, status=1).stderr)
            with self.assertRaises(sdk.Refused) as refused:
                connection.reload_pack("lead")
            self.assertEqual(refused.exception.code_name, "unknown_material")
            self.assertIn("banknote", str(refused.exception))
            self.assertEqual(connection.list_packs(), known)
        np.testing.assert_array_equal(while_broken, before)
        np.testing.assert_array_equal(after, before)

    def test_many_changes_of_a_live_session_lose_nothing(self):
        with self.connected() as connection, live_sound({"control": self.control}):
            session = connection.list_sessions()[0].session_id
            for turn in range(10):
                self.turn_friction("printer-paper", -1)
                connection.reload_pack("printer-paper")
                connection.change_pack(session, 1, ("banknote", "printer-paper")[turn % 2])
                connection.set_gains(session, [sdk.Gain(-turn)])
                time.sleep(0.1)
            statistics = connection.statistics(session)
            self.assertEqual((statistics.messages_refused, statistics.cues_dropped, statistics.samples_not_finite), (0, 0, 0))
            self.assertEqual((statistics.voices_dropped, statistics.sounds_missing, statistics.sources_dropped), (0, 0, 0))


class Figures(RustleTest):
    def test_the_daemon_tells_of_itself(self):
        nowhere = {"PULSE_SERVER": f"unix:{self.folder}/none", "JACK_DEFAULT_SERVER": "rustle-none"}
        with unittest.mock.patch.dict(os.environ, nowhere), daemon(self.folder, "--device", "no such device") as ends:
            with sdk.Connection.connect(ends["control"]) as connection:
                self.assertEqual(connection.server_statistics().sessions, 0)
                with live_sound(ends):
                    before = connection.server_statistics()
                    time.sleep(1)
                    after = connection.server_statistics()
        self.assertEqual((after.sessions, after.playback.device, after.playback.samples_played), (1, "", 0))
        self.assertGreater(after.uptime_s, before.uptime_s + 0.9)
        self.assertGreater(after.cpu_s, before.cpu_s)
        by_name = {thread.name: thread for thread in after.threads}
        for name in ("rustle-render", "rustle-analyse", "rustled"):
            self.assertGreater(by_name[name].count, 0, name)
            self.assertGreater(by_name[name].cpu_s, 0, name)
        self.assertLessEqual(sum(thread.cpu_s for thread in after.threads), after.cpu_s + 0.1)

    def test_without_playback_there_are_no_figures_of_it(self):
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            self.assertIsNone(connection.server_statistics().playback)


if __name__ == "__main__":
    main()
