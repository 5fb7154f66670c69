#!/usr/bin/python3
"""Packs from recordings: what is built of sounds with known answers, and a pack of real recordings in a render."""
import json
import os
import pathlib
import re
import unittest

import numpy as np

from support import BUILD, SHARED, RustleTest, bent, curvature_of, grid, main, read_wav, rms_dbfs, rustle, save_npz

RATE = 48000
RECORDINGS = SHARED / "recordings"
CRUMPLE = SHARED / "captures/blender_crumple.npz"
SHARED_MANIFEST = pathlib.Path(__file__).parent / "shared_recordings.toml"


def write_wav(path, samples, rate=RATE):
    """16 bit, [n] or [n, channels]."""
    samples = np.asarray(samples).reshape(len(samples), -1)
    data = np.round(np.clip(samples, -1, 1) * 32767).astype("<i2").tobytes()
    channels = samples.shape[1]
    head = b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little")
    head += (1).to_bytes(2, "little") + channels.to_bytes(2, "little") + rate.to_bytes(4, "little")
    head += (rate * channels * 2).to_bytes(4, "little") + (channels * 2).to_bytes(2, "little") + (16).to_bytes(2, "little")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head + b"data" + len(data).to_bytes(4, "little") + data)


def bursts(seconds, times, amplitudes, t60, random, rate=RATE, noise=1e-4):
    x = noise * random.standard_normal(int(seconds * rate))
    n = np.arange(int(1.2 * t60 * rate))
    for time, amplitude in zip(times, amplitudes):
        start = int(time * rate)
        x[start:start + len(n)] += amplitude * 10 ** (-3 * n / rate / t60) * random.uniform(-1, 1, len(n))
    return x


def coloured(seconds, random, rms, rate=RATE):
    """Noise whose density falls by 12 dB an octave above 2 kHz and below 300 Hz, and that density per Hz."""
    n = int(seconds * rate)
    f = np.fft.rfftfreq(n, 1 / rate)
    shape = 1 / (1 + (f / 2000) ** 2) * (f / 300) ** 2 / (1 + (f / 300) ** 2)
    x = np.fft.irfft(np.fft.rfft(random.standard_normal(n)) * shape, n)
    return x * rms / np.sqrt(np.mean(x ** 2)), lambda g: np.interp(g, f, shape)


MANIFEST = """
[pack]
material = "test-paper"
touched_surface = "board"
licence = "CC0-1.0"
origin = "made by a test"
[[recording]]
files = "flaps/*.wav"
class = "flap"
[[recording]]
files = "crumpling.wav"
class = "crumple"
channel = 2
[[recording]]
files = "bent.wav"
class = "slide"
l_r = 0.1
l_c = 0.2
speed = 0.2
[[recording]]
files = "flat.wav"
class = "slide"
constrained = true
speed_track = "flat.csv"
"""
CLACS = [0.25, 0.4, 0.62, 0.9, 1.3, 1.37, 1.8]
FLAPS = {"r100_c200": [0.3, 1.2, 2.1], "r050_c100": [0.4, 1.4]}


class KnownRecordings(RustleTest):
    def recordings(self):
        random = np.random.default_rng(3)
        folder = self.folder / "recordings"
        for name, times in FLAPS.items():
            write_wav(folder / f"flaps/{name}.wav", bursts(3, times, [0.4] * len(times), 0.25, random, 44100), 44100)
        clacs = bursts(2.2, CLACS, [0.5 * 0.8 ** i for i in range(len(CLACS))], 0.02, random)
        write_wav(folder / "crumpling.wav", np.stack([np.zeros_like(clacs), clacs], 1))
        bent, self.density = coloured(20, random, 0.05)
        write_wav(folder / "bent.wav", bent)
        write_wav(folder / "flat.wav", coloured(5, random, 0.01)[0])
        (folder / "flat.csv").write_text("time_s,speed_m_per_s\n0,0.1\n5,0.1\n")
        (folder / "recordings.toml").write_text(MANIFEST)
        return folder

    def build(self, folder, name="pack", *options):
        return json.loads(rustle("pack", "build", folder, "-o", self.folder / name, "--json", *options).stdout)

    def test_units_where_the_sounds_are(self):
        report = self.build(self.recordings())
        found = {source["file"]: source for source in report["sources"]}
        for name, times in FLAPS.items():
            kept = [s for s in found[f"flaps/{name}.wav"]["segments"] if s["kept_as"]]
            np.testing.assert_allclose([s["from_s"] for s in kept], times, atol=0.0015)
            self.assertEqual(found[f"flaps/{name}.wav"]["l_r_m"], int(name[1:4]) / 1000)
        kept = [s for s in found["crumpling.wav"]["segments"] if s["kept_as"]]
        np.testing.assert_allclose([s["from_s"] for s in kept], CLACS, atol=0.0015)
        self.assertEqual(report["units"], len(CLACS) + sum(map(len, FLAPS.values())))
        self.assertEqual(report["spectra"], 2)
        self.assertEqual(report["findings"], [])
        self.assertTrue(any("2 of the usual 81" in line for line in report["missing"]))

    def test_spectrum_within_1_db(self):
        folder = self.recordings()
        self.build(folder)
        m = np.load(self.folder / "pack/friction/r100_c200.npy").astype(float)
        frequency = np.linspace(0, RATE / 2, len(m))
        expected = self.density(frequency) / np.sqrt(1 + (100 / np.maximum(frequency, 1)) ** 10)
        difference = []
        for low in 300 * 2 ** (np.arange(16) / 3):
            band = (frequency >= low) & (frequency < low * 2 ** (1 / 3))
            difference.append(10 * np.log10((m[band] ** 2).mean() / (expected[band] ** 2).mean()))
        difference = np.array(difference) - np.mean(difference)
        self.assertLess(np.abs(difference).max(), 1.0)
        # The reference event: 0.1 m/s at -32 dBFS.
        self.assertAlmostEqual(10 * np.log10((m ** 2).mean()), -32, delta=0.1)

    def test_pack_is_a_pack(self):
        folder = self.recordings()
        self.build(folder)
        self.build(folder, "again")
        files = sorted(p.relative_to(self.folder / "pack") for p in (self.folder / "pack").rglob("*") if p.is_file())
        for file in files:
            self.assertEqual((self.folder / "pack" / file).read_bytes(), (self.folder / "again" / file).read_bytes(), file)
        self.assertIn("in order", rustle("pack", "check", self.folder / "pack").stdout)
        for name in ("shown.png", "shown.html"):
            rustle("pack", "show", self.folder / "pack", "-o", self.folder / name)
        self.assertEqual((self.folder / "shown.png").read_bytes()[:4], b"\x89PNG")
        page = (self.folder / "shown.html").read_text()
        self.assertEqual(len(re.findall(r"<tr><td>(?:clac|flap|friction)", page)), len(CLACS) + 5 + 2)
        self.assertNotRegex(page, r"(src|href)=\"http|<script")

    def test_play_sounds_at_its_levels(self):
        self.build(self.recordings())
        wav = self.folder / "tour.wav"
        tour = json.loads(rustle("pack", "play", self.folder / "pack", "-o", wav, "--json").stdout)
        rate, samples = read_wav(wav)
        self.assertEqual({s["class"] for s in tour["sounds"]}, {"flap", "clac", "friction"})
        for sound in tour["sounds"]:
            part = samples[int(sound["from_s"] * rate):int(sound["to_s"] * rate)]
            self.assertGreater(np.abs(part).max(), 1e-3, sound)
        reference = [s["peak_dbfs"] for s in tour["sounds"] if s["class"] == "flap" and s["l_r_m"] == 0.1]
        self.assertAlmostEqual(np.mean(reference), -20, delta=1.0)
        slide = [s["rms_dbfs"] for s in tour["sounds"] if s["class"] == "friction" and s["l_r_m"] == 0.1]
        self.assertAlmostEqual(slide[0], -32, delta=1.0)
        rustle("pack", "play", self.folder / "pack", "--class", "friction", "--l-r", 0.1, "--l-c", 0.2, "--speed", 0.2, "-o", wav)
        rate, faster = read_wav(wav)
        self.assertAlmostEqual(rms_dbfs(faster[int(0.5 * rate):int(1.6 * rate)]), -26, delta=1.2)

    def test_a_built_pack_sounds_in_a_render(self):
        self.build(self.recordings(), "packs")
        material, triangles = grid(0.2, 0.1, 22, 11)
        k = curvature_of(0.2, 0.10)
        times = np.arange(72) / 60
        positions = [bent(material, -k * np.clip((t - 0.5073) / 0.1, -1, 1)) + [0, 0, 0.3] for t in times]
        capture = self.import_npz(save_npz(self.folder / "turn.npz", positions, triangles, times, material_coordinates=material),
                                  "--material", "test-paper")
        out = self.folder / "out.wav"
        rustle("render", capture, "-o", out, env={**os.environ, "RUSTLE_PACK_PATH": str(self.folder / "packs")})
        rate, samples = read_wav(out)
        self.assertEqual(np.abs(samples[:int(0.5 * rate)]).max(), 0)
        self.assertGreater(np.abs(samples[int(0.5 * rate):int(0.6 * rate)]).max(), 0.01)


CLOTH = """
[pack]
material = "felt"
touched_surface = "felt"
licence = "CC0-1.0"
origin = "made by a test"
[cloth]
[[recording]]
files = "motion.wav"
class = "cloth"
[[recording]]
files = "roller.wav"
class = "slide"
speed_track = "roller.csv"
[[recording]]
files = "shearing.wav"
class = "crumple"
"""


class Cloth(RustleTest):
    def built(self):
        random = np.random.default_rng(5)
        folder = self.folder / "recordings"
        swell = np.repeat(random.uniform(0.02, 1, 60), RATE // 4)
        write_wav(folder / "motion.wav", coloured(15, random, 0.1)[0] * swell)
        speed = 0.06 * 30 ** (np.arange(10 * RATE) / 10 / RATE)
        write_wav(folder / "roller.wav", coloured(10, random, 0.05)[0] * speed)
        (folder / "roller.csv").write_text("\n".join(f"{t},{0.06 * 30 ** (t / 10)}" for t in np.arange(0, 10.1, 0.1)))
        times = np.arange(0.2, 9.8, 0.3)
        write_wav(folder / "shearing.wav", bursts(10, times, 0.5 * random.uniform(0.02, 1, len(times)) ** 2, 0.02, random))
        (folder / "recordings.toml").write_text(CLOTH)
        report = json.loads(rustle("pack", "build", folder, "-o", self.folder / "felt", "--json").stdout)
        return self.folder / "felt", report

    def test_built_checked_shown_and_played(self):
        pack, report = self.built()
        self.assertGreater(report["units"], 15)
        self.assertGreaterEqual(report["spectra"], 12)
        self.assertFalse([f for f in report["findings"] if f["severity"] == "error"], report["findings"])
        manifest = json.loads((pack / "pack.json").read_text())["cloth"]
        rows = np.load(pack / manifest["features"]["causal"])
        self.assertEqual(rows.shape[1], 3)
        self.assertAlmostEqual(len(rows) / 240, 15, delta=0.5)
        # Friction as loud as its speed, and the sweep's rows as the manifest says.
        sweep = np.load(pack / manifest["friction"]["file"]).astype(float)
        level_db = 10 * np.log10((sweep ** 2).mean(1)) - 20 * np.log10(manifest["friction"]["speeds_m_per_s"])
        self.assertLess(np.ptp(level_db), 3)
        for name in ("felt.png", "felt.html"):
            rustle("pack", "show", pack, "-o", self.folder / name)
        self.assertEqual((self.folder / "felt.png").read_bytes()[:4], b"\x89PNG")
        self.assertNotRegex((self.folder / "felt.html").read_text(), r"(src|href)=\"http|<script")
        wav = self.folder / "tour.wav"
        tour = json.loads(rustle("pack", "play", pack, "-o", wav, "--json").stdout)
        self.assertEqual({s["class"] for s in tour["sounds"]}, {"friction", "crumpling", "corpus"})
        rate, samples = read_wav(wav)
        slides = [s for s in tour["sounds"] if s["class"] == "friction"]
        for slide in slides:
            part = samples[int((slide["from_s"] + 0.3) * rate):int((slide["to_s"] - 0.3) * rate)]
            self.assertAlmostEqual(rms_dbfs(part), 20 * np.log10(0.05 * slide["speed_m_per_s"]), delta=2)
        self.assertIn("pack of cloth", rustle("pack", "play", pack, "--class", "flap", "-o", wav, status=2).stderr)

    def test_calibrated_by_proposals_then_by_hand(self):
        pack, _ = self.built()
        others = {p: p.read_bytes() for p in pack.rglob("*") if p.suffix == ".flac" or "friction" in p.name}
        pairs, picture = self.folder / "pairs.csv", self.folder / "warp.png"
        proposed = json.loads(rustle("pack", "calibrate", pack, "--write-correspondences", pairs, "--picture", picture, "--json").stdout)
        self.assertTrue(proposed["proposed"])
        self.assertEqual(len(proposed["correspondences"]), 14)
        before = sum(c["distance_before"] for c in proposed["correspondences"])
        self.assertLess(sum(c["distance_after"] for c in proposed["correspondences"]), before)
        self.assertEqual(picture.read_bytes()[:4], b"\x89PNG")
        self.assertEqual(len(pairs.read_text().splitlines()), 15)
        events = self.folder / "events.jsonl"
        events.write_text("".join(json.dumps({"kind": "crumpling", "amplitude": 0.01 * k, "amplitude_unit": "m"}) + "\n" for k in range(1, 101)))
        target = self.folder / "target.wav"
        write_wav(target, coloured(5, np.random.default_rng(8), 0.02)[0])
        pairs.write_text("target_s,database_s,length_s\n0.5,1.0,0.1\n2.5,7.0,0.1\n99,0,0.1\n")
        given = json.loads(rustle("pack", "calibrate", pack, "--target", target, "--correspondences", pairs, "--lambda", 0,
                                  "--events", events, "--quantile", 0.3, "--speed-divisor", 4, "--speed-exponent", 1.5, "--json").stdout)
        self.assertEqual([c["units"] for c in given["correspondences"]], [24, 24, 0])
        self.assertLess(max(c["distance_after"] for c in given["correspondences"]), 1e-4)
        self.assertAlmostEqual(given["events"]["least_m"], 0.30, delta=0.011)
        manifest = json.loads((pack / "pack.json").read_text())["cloth"]
        self.assertEqual(manifest["warp"]["lambda"], 0)
        self.assertEqual(manifest["friction"]["speed_compression"], {"divisor": 4, "exponent": 1.5})
        self.assertEqual(len(np.load(pack / manifest["warp"]["causal"]["file"])), 48)
        for path, data in others.items():
            self.assertEqual(path.read_bytes(), data, path)

    def test_a_replaced_recording_is_found_and_measured_anew(self):
        pack, _ = self.built()
        manifest = json.loads((pack / "pack.json").read_text())["cloth"]
        name = manifest["recordings"][0]["file"]
        other = pack / name.replace(".flac", ".wav")
        write_wav(other, coloured(12, np.random.default_rng(9), 0.05)[0])
        (pack / name).unlink()
        text = (pack / "pack.json").read_text()
        (pack / "pack.json").write_text(text.replace(name, name.replace(".flac", ".wav")))
        said = rustle("pack", "check", pack, status=1).stdout
        self.assertIn("rustle pack calibrate", said)
        self.assertIn("units of 3 features", said)
        rustle("pack", "calibrate", pack)
        self.assertNotIn("error", rustle("pack", "check", pack).stdout)

    def test_calibration_that_cannot_be_done_names_the_remedy(self):
        pack, _ = self.built()
        pairs = self.folder / "pairs.csv"
        pairs.write_text("0.1, soon\n")
        for arguments, words in ((["--correspondences", pairs], "line 1"), (["--correspondences", self.folder / "none.csv"], "cannot be read"),
                                 (["--target", pairs], "render the target as WAV"), (["--events", pairs], "is not an event")):
            with self.subTest(arguments=arguments):
                self.assertIn(words, rustle("pack", "calibrate", pack, *arguments, status=1).stderr)
        pairs.write_text("99, 99, 0.1\n")
        self.assertIn("beyond the end", rustle("pack", "calibrate", pack, "--correspondences", pairs, status=1).stderr)
        self.assertIn("pack of paper", rustle("pack", "calibrate", BUILD / "share/rustle/packs/banknote", status=1).stderr)


class Refusals(RustleTest):
    def test_example_manifest_is_where_to_start(self):
        printed = rustle("pack", "build", "--print-manifest").stdout
        self.assertIn("[[recording]]", printed)
        self.assertEqual(printed, rustle("pack", "build", "--example").stdout)

    def test_wrong_use_names_the_remedy(self):
        for arguments, status, words in (
                ([], 2, "FOLDER -o PACK"),
                ([self.folder], 2, "-o PACK"),
                ([self.folder / "none", "-o", self.folder / "pack"], 2, "is not a folder"),
                ([self.folder, "-o", self.folder], 2, "holds the recordings"),
                ([self.folder, "-o", self.folder.parent], 2, "holds the recordings"),
                ([self.folder, "-o", self.folder / "pack"], 1, "--print-manifest")):
            with self.subTest(arguments=arguments):
                self.assertIn(words, rustle("pack", "build", *arguments, status=status).stderr)

    def test_nothing_is_replaced_unasked(self):
        occupied = self.folder / "occupied"
        occupied.mkdir()
        (occupied / "letter.txt").write_text("dear")
        for force in ([], ["--force"]):
            done = rustle("pack", "generate", "--material", "banknote", "-o", occupied, *force, status=1)
            self.assertIn("not a sound pack", done.stderr)
        pack = self.folder / "pack"
        pack.mkdir()
        (pack / "pack.json").write_bytes((BUILD / "share/rustle/packs/banknote/pack.json").read_bytes())
        self.assertIn("--force", rustle("pack", "generate", "--material", "banknote", "-o", pack, status=1).stderr)
        (pack / "letter.txt").write_text("dear")
        done = rustle("pack", "generate", "--material", "banknote", "-o", pack, "--force", status=1)
        self.assertIn("letter.txt", done.stderr)
        self.assertEqual((pack / "letter.txt").read_text(), "dear")


@unittest.skipUnless(RECORDINGS.is_dir() and CRUMPLE.is_file(), "the shared recordings are not here")
class SharedRecordings(RustleTest):
    def test_a_pack_of_real_recordings_plays_in_a_real_crumple(self):
        pack = self.folder / "mixed-paper"
        report = json.loads(rustle("pack", "build", RECORDINGS, "--manifest", SHARED_MANIFEST, "-o", pack, "--json").stdout)
        print("units", report["units"], "spectra", report["spectra"], "left out", report["left_out"])
        self.assertGreaterEqual(report["units"], 15)
        self.assertEqual(report["spectra"], 3)
        self.assertFalse([f for f in report["findings"] if f["severity"] == "error"])
        for source in report["sources"]:
            for segment in source["segments"]:
                self.assertTrue(segment["kept_as"] or segment["reason"], "either kept or with a reason")
        capture = self.import_npz(CRUMPLE, "--material", "mixed-paper")
        out, events = self.folder / "out.wav", self.folder / "out.jsonl"
        rustle("render", capture, "-o", out, "--events", events, env={**os.environ, "RUSTLE_PACK_PATH": str(pack)})
        rate, samples = read_wav(out)
        self.assertTrue(np.isfinite(samples).all())
        self.assertLessEqual(np.abs(samples).max(), 1.0)
        print("level %.1f dBFS, peak %.2f" % (rms_dbfs(samples), np.abs(samples).max()))
        loudest = max((json.loads(line) for line in events.read_text().splitlines() if '"crumpling"' in line),
                      key=lambda e: e["amplitude"])
        first = int(loudest["time_s"] * rate)
        self.assertGreater(rms_dbfs(samples[first:first + rate // 20]), -60)


if __name__ == "__main__":
    main()
