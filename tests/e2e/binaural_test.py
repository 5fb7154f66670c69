#!/usr/bin/python3
"""Sound for headphones, and friction at other block sizes: by the programs, from a capture to what is heard."""
import json

import numpy as np

from support import RustleTest, bent, curvature_of, daemon, grid, main, read_wav, rms_dbfs, rustle, save_npz, table


class Binaural(RustleTest):
    def passing(self):
        """A bent sheet slides along a table from the listener's left to the right and then turns inside out."""
        material, triangles = grid(0.2, 0.1, 20, 10)
        times = np.arange(241) / 60
        side = np.interp(times, [0, 3, 4], [-0.75, 0.75, 0.75])
        curvature = curvature_of(0.2, 0.1) * np.interp(times, [0, 3.4, 3.5, 4], [1, 1, -1, -1])
        positions = np.array([bent(material, k) + [x, 0, 0.001] for x, k in zip(side, curvature)])
        path = save_npz(self.folder / "passing.npz", positions, triangles, times, material_coordinates=material, **table())
        return self.import_npz(path)

    def test_each_ear_hears_its_side(self):
        capture = self.passing()
        for hrtf in ("structural", "kemar"):
            rate, ears, _ = self.render(capture, hrtf, "--channels", "binaural", "--hrtf", hrtf, "--listener", "0,-0.6,0.4", "--facing", "0,1,0")
            self.assertEqual(ears.shape[1], 2)
            left, right = ([rms_dbfs(ears[int(a * rate):int(b * rate), ear]) for a, b in ((0.2, 0.9), (2.1, 2.8), (3.4, 3.8))]
                           for ear in (0, 1))
            self.assertGreater(left[0], right[0] + 2)
            self.assertGreater(right[1], left[1] + 2)
            self.assertGreater(right[2], left[2] + 2)
        rate, mono, _ = self.render(capture, "mono", "--channels", "mono", "--listener", "0,-0.6,0.4", "--facing", "0,1,0")
        self.assertAlmostEqual(rms_dbfs(ears), rms_dbfs(mono), delta=4)

    def test_block_size_does_not_matter(self):
        capture = self.passing()
        options = ("--channels", "binaural", "--hrtf", "structural")
        _, one, _ = self.render(capture, "one", *options, "--block-size", "64", "--workers", "1")
        _, other, _ = self.render(capture, "other", *options, "--block-size", "1000", "--workers", "2")
        self.assertTrue(np.array_equal(one, other))

    def test_mistakes_name_the_remedy(self):
        capture = self.passing()
        out = self.folder / "never.wav"
        wrong = self.folder / "wrong.sofa"
        wrong.write_bytes(b"no SOFA file" * 100)
        for options, words in ((("--channels", "binaural", "--hrtf", "nobody"), ("nobody", "structural")),
                               (("--channels", "binaural", "--hrtf", wrong), ("wrong.sofa", "structural")),
                               (("--channels", "stereo", "--hrtf", "kemar"), ("--channels binaural",)),
                               (("--friction-fft", "1000"), ("1000",))):
            said = rustle("render", capture, "-o", out, *options, status=2).stderr
            for word in words:
                self.assertIn(word, said)

    def test_every_friction_block_size_has_the_level(self):
        capture = self.passing()
        level = {}
        for size in (0, 128, 2048, 8192):
            options = ("--friction-fft", size) if size else ()
            rate, samples, _ = self.render(capture, f"fft{size}", "--channels", "mono", *options)
            level[size] = rms_dbfs(samples[rate // 4:11 * rate // 4])
        for size, db in level.items():
            self.assertAlmostEqual(db, level[0], delta=1.0, msg=size)

    def test_daemon_serves_heads_by_name_only(self):
        capture = self.passing()
        with daemon(self.folder, "--hrtf", "structural") as ends:
            wav = self.folder / "back.wav"
            replay = ("replay", capture, "--clock", "simulation", "--control", ends["control"])
            rustle(*replay, "--channels", "binaural", "--hrtf", "structural", "--wav", wav)
            rate, ears = read_wav(wav)
            self.assertEqual(ears.shape[1], 2)
            self.assertGreater(rms_dbfs(ears), -60)
            _, offline, _ = self.render(capture, "offline", "--channels", "binaural", "--hrtf", "structural")
            self.assertTrue(np.array_equal(ears, offline), "the daemon's head is the renderer's")
            refused = rustle(*replay, "--channels", "binaural", "--hrtf", "/usr/share/libmysofa/default.sofa", status=1)
            self.assertIn("structural", refused.stderr)


if __name__ == "__main__":
    main()
