#!/usr/bin/python3
"""Cloth through the programs: the demo, the same samples whatever renders them, the offline searches, load, and a simulator's
captured cloth in every material."""
import json
import unittest

import numpy as np

from support import SHARED, RustleTest, daemon, grid, main, read_wav, rms_dbfs, rustle, save_npz, table

CAPTURE = SHARED / "captures/blender_cotton.npz"
MATERIALS = ("cotton", "polyester", "windbreaker", "corduroy")


def rubbed_cloth(path, seconds=2.0, fps=60):
    """Cloth that rests, is rubbed to and fro over a table, and rests."""
    material, triangles = grid(0.4, 0.3, 16, 12)
    times = np.arange(int(seconds * fps) + 1) / fps
    moving = (times > 0.4) & (times < seconds - 0.8)
    x = np.cumsum(np.where(moving, 0.7 * np.sin(2 * np.pi * 1.5 * (times - 0.4)), 0)) / fps
    positions = np.stack([np.stack([material[:, 0] + dx, material[:, 1], np.full(len(material), 0.001)], 1) for dx in x])
    return save_npz(path, positions, triangles, times, material_coordinates=material, **table())


class Cloth(RustleTest):
    def capture(self):
        return self.import_npz(rubbed_cloth(self.folder / "rubbed.npz"), "--kind", "cloth", "--material", "cotton",
                               "--obstacle-surface", "wooden-table")

    def test_sounds_while_it_slides(self):
        rate, samples, events = self.render(self.capture(), "out", "--channels", "mono")
        sliding, before = samples[int(0.5 * rate):int(1.1 * rate)], samples[:int(0.3 * rate)]
        self.assertGreater(rms_dbfs(sliding), -70)
        self.assertEqual(np.abs(before).max(), 0)
        self.assertEqual(np.abs(samples[-int(0.2 * rate):]).max(), 0)

    def test_any_block_size_and_workers_and_through_a_daemon(self):
        capture = self.capture()
        reference = self.render(capture, "one")[1]
        self.assertGreater(np.abs(reference).max(), 0)
        for options in (("--block-size", 1000), ("--workers", 2), ("--workers", 4, "--block-size", 64)):
            np.testing.assert_array_equal(self.render(capture, "other", *options)[1], reference)
        wav = self.folder / "heard.wav"
        with daemon(self.folder) as ends:
            rustle("replay", capture, "--clock", "simulation", "--control", ends["control"], "--wav", wav)
        np.testing.assert_array_equal(read_wav(wav)[1], reference)

    def test_searches_offline(self):
        capture = self.capture()
        sounds = {}
        for search in ("causal", "symmetric", "global"):
            rate, sounds[search], _ = self.render(capture, search, "--channels", "mono", "--cloth-features", search)
            self.assertGreater(rms_dbfs(sounds[search][int(0.5 * rate):int(1.1 * rate)]), -70, search)
        self.assertFalse(np.array_equal(sounds["causal"], sounds["symmetric"]))
        self.assertFalse(np.array_equal(sounds["symmetric"], sounds["global"]))
        np.testing.assert_array_equal(self.render(capture, "again", "--channels", "mono", "--cloth-features", "global",
                                                  "--workers", 2)[1], sounds["global"])

    def test_paper_and_cloth_keep_time_together(self):
        """Cloth looks ahead, paper does not: on the clock of the simulation both are heard at their own time."""
        capture = self.capture()
        cloth = np.abs(self.render(capture, "cloth", "--channels", "mono")[1][:, 0])
        paper = np.abs(self.render(capture, "paper", "--channels", "mono", "--material", "printer-paper")[1][:, 0])
        envelope = [np.convolve(x, np.ones(480), "same")[::48] for x in (cloth, paper)]
        length = min(map(len, envelope))
        a, b = (np.log10(e[:length] / e.max() + 1e-3) for e in envelope)
        lag = np.argmax(np.correlate(a - a.mean(), b - b.mean(), "full")) - (length - 1)
        self.assertLess(abs(lag), 30)  # ms

    def test_demo(self):
        done = rustle("demo", "cloth", "-o", self.folder / "demo", "--capture", self.folder / "demo.mcap", "--triangles", 446)
        self.assertIn("cotton", done.stdout)
        rate, samples = read_wav(self.folder / "demo.wav")
        self.assertGreater(rms_dbfs(samples[3 * rate // 2:3 * rate]), -75)
        self.assertTrue((self.folder / "demo.png").stat().st_size > 10_000)
        self.assertTrue(np.array_equal(self.render(self.folder / "demo.mcap", "again", "--seed", 1)[1], samples))

    def test_load(self):
        figures = json.loads(rustle("load", "--kind", "cloth", "--sessions", 2, "--triangles", 446, "--seconds", 3, "--json").stdout)
        self.assertTrue(figures["sums_exact"])
        # Cloth's own latency comes on top of the playout delay that was asked for, and is told.
        self.assertGreater(figures["playout_delay_ms"], 40 + 60)
        self.assertLess(figures["playout_delay_ms"], 40 + 110)
        self.assertGreaterEqual(figures["latency_ms"]["p50"], 100)
        self.assertLess(figures["longest_silence_s"], 0.5)


@unittest.skipUnless(CAPTURE.exists(), "the shared captures are not here")
class SimulatorsCloth(RustleTest):
    def test_every_material_follows_its_target(self):
        done = rustle("validate", "--only", "cloth", "--captures", CAPTURE.parent, "--json")
        checks = {check["name"]: check for check in json.loads(done.stdout)["checks"]}
        for material in MATERIALS:
            for what in ("loudness", "repeated", "joins"):
                self.assertTrue(checks[f"cloth/{what}/blender_cotton/{material}"]["holds"], (what, material))


if __name__ == "__main__":
    main()
