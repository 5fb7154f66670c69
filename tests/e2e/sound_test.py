#!/usr/bin/python3
"""What must hold of the sound of sheets with known answers, through import, render and the event list."""
import numpy as np

from support import RustleTest, bent, curvature_of, grid, main, rms_dbfs, save_npz, table


def third_octaves_db(samples, rate, low=100, high=20000):
    """Level per third-octave band of the mean of the channels' power."""
    power = np.mean(np.abs(np.fft.rfft(samples, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(samples), 1 / rate)
    edges = low * 2 ** (np.arange(int(3 * np.log2(high / low)) + 1) / 3)
    return 10 * np.log10([power[(frequency >= a) & (frequency < b)].sum() / len(samples) ** 2 + 1e-30 for a, b in zip(edges, edges[1:])])


def quadratic_form_distance(a, b, rate, bins=256):
    """Of the L1-normalised mean magnitude spectra, A = 1 - |i-j|/(N-1) (method.md, P12)."""
    def histogram(x):
        frames = np.lib.stride_tricks.sliding_window_view(x[:, 0], 2 * bins)[::bins] * np.hanning(2 * bins)
        magnitude = np.abs(np.fft.rfft(frames, axis=1)).mean(0)[:bins]
        return magnitude / magnitude.sum()
    return np.sqrt(2 / (bins - 1) * np.sum((np.cumsum(histogram(a)) - np.cumsum(histogram(b))) ** 2))


class Sliding(RustleTest):
    def slide(self, name, width, height, speed_of, seconds=3.0, fps=60, compression=0.3, options=(), nx=20, ny=14):
        """A sheet bent along its width slides along y over a table."""
        material, triangles = grid(width, height, nx, ny)
        shape = bent(material, curvature_of(width, compression))
        times = np.arange(int(seconds * fps) + 1) / fps
        speed = np.array([speed_of(t) for t in times])
        way = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 / fps)])
        positions = shape[None] + way[:, None, None] * np.array([0, 1, 0])
        path = save_npz(self.folder / f"{name}.npz", positions, triangles, times, material_coordinates=material, **table())
        return self.render(self.import_npz(path), name, "--channels", "mono", "--listener", "0,-1,0.6", *options)

    def test_level_follows_speed(self):
        # Far from the listener's change of distance: both sheets cover the same way.
        rate, slow, _ = self.slide("slow", 0.2, 0.1, lambda t: 0.05, seconds=6)
        rate, fast, events = self.slide("fast", 0.2, 0.1, lambda t: 0.1, seconds=3)
        change = rms_dbfs(fast[rate // 2:-rate // 2]) - rms_dbfs(slow[rate:-rate])
        self.assertAlmostEqual(change, 20 * np.log10(2), delta=1.0)
        friction = [e for e in events if e["kind"] == "friction"]
        self.assertTrue(friction)
        for event in friction:
            self.assertAlmostEqual(event["amplitude"], 0.1, delta=0.004)
            self.assertEqual(event["amplitude_unit"], "m/s")

    def test_free_border_length_is_heard(self):
        rate, short, one = self.slide("short", 0.1, 0.1, lambda t: 0.1)
        rate, long, other = self.slide("long", 0.25, 0.1, lambda t: 0.1)
        self.assertGreaterEqual(quadratic_form_distance(short, long, rate), 0.03)
        for events, l_c in ((one, 0.2), (other, 0.5)):
            loudest = max((e for e in events if e["kind"] == "friction"), key=lambda e: e["area_m2"])
            self.assertLess(l_c - loudest["resonators"][0]["l_c_m"], 0.05 * l_c)
            self.assertLess(loudest["resonators"][0]["l_c_m"], 1.02 * l_c)

    def test_a_still_sheet_is_silent(self):
        _, samples, events = self.slide("still", 0.2, 0.1, lambda t: 0.0, seconds=1)
        self.assertEqual(events, [])
        self.assertEqual(np.abs(samples).max(), 0)

    def test_rates_agree(self):
        spectra, seen = {}, {}
        for rate in (44100, 48000, 96000):
            got, samples, events = self.slide(f"at{rate}", 0.2, 0.1, lambda t: 0.1, seconds=12, options=("--rate", rate))
            self.assertEqual(got, rate)
            spectra[rate] = third_octaves_db(samples[:12 * rate], rate)
            seen[rate] = [(e["kind"], round(e["time_s"], 4), round(e["amplitude"], 6)) for e in events]
        for rate in (44100, 96000):
            self.assertEqual(seen[rate], seen[48000])
            # Below 1 kHz a band holds a bin or two, whose places differ with the rate.
            difference = np.abs(spectra[rate] - spectra[48000])
            self.assertLess(difference.max(), 1.5)
            self.assertLess(difference[10:].max(), 0.5)


class Reversal(RustleTest):
    def test_one_flap_at_the_analytic_moment(self):
        for name, fps, zero in (("at60", 60, 0.5073), ("at120", 120, 0.4921)):
            with self.subTest(fps):
                material, triangles = grid(0.2, 0.1, 22, 11)
                k = curvature_of(0.2, 0.10)
                times = np.arange(int(1.2 * fps)) / fps
                positions = [bent(material, -k * np.clip((t - zero) / 0.1, -1, 1)) + [0, 0, 0.3] for t in times]
                path = save_npz(self.folder / f"{name}.npz", positions, triangles, times, material_coordinates=material)
                rate, samples, events = self.render(self.import_npz(path), name)
                flaps = [e for e in events if e["continues"] is None]
                self.assertEqual(len(flaps), 1)
                self.assertLess(abs(flaps[0]["time_s"] - zero), 1e-3)
                self.assertFalse(flaps[0]["resonators"][0]["constrained"])
                first = np.flatnonzero(np.abs(samples).max(1) > 1e-5)[0] / rate
                self.assertLess(abs(first - zero), 3e-3, "the sound starts at the event")

    def test_rigid_motion_is_silent(self):
        for nx, ny in ((13, 7), (36, 18), (140, 71)):
            for k in (0.0, 5.0):
                with self.subTest(triangles=2 * nx * ny, curvature=k):
                    material, triangles = grid(0.297, 0.21, nx, ny)
                    shape = bent(material, k)
                    times = np.arange(40) / 60
                    positions = []
                    for t in times:
                        a = 2.0 * t
                        turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
                        positions.append(shape @ turn.T + [10 + t, -4, 2 * t])
                    path = save_npz(self.folder / "rigid.npz", positions, triangles, times, material_coordinates=material)
                    _, samples, events = self.render(self.import_npz(path))
                    self.assertEqual(events, [])
                    self.assertEqual(np.abs(samples).max(), 0)


if __name__ == "__main__":
    main()
