#!/usr/bin/python3
"""Tears: what the daemon finds in a simulator's torn sheet beside the truth from its material coordinates, and how sent and
found tears sound."""
import json
import sys
import unittest

import numpy as np

from support import BUILD, SHARED, RustleTest, daemon, grid, main, read_wav, rms_dbfs, save_npz

sys.path.insert(0, str(BUILD / "python"))
import rustle as sdk

CAPTURES = SHARED / "captures"
TRUTH = SHARED / "reference/expected/arcsim_tear.truth.json"


def tearing(events):
    return [e for e in events if e["kind"] == "tearing"]


def torn_grid(width, height, nx, ny, cut):
    """A rectangle cut along its middle column from below through `cut` cells: material coordinates, triangles."""
    material, triangles = grid(width, height, nx, ny)
    column = nx // 2
    copies = {}
    material, triangles = list(map(tuple, material)), triangles.copy()
    for j in range(cut if cut < ny else ny + 1):
        v = j * (nx + 1) + column
        copies[v] = len(material)
        material.append(material[v])
    x = np.array(material)[:, 0]
    for t in triangles:
        if x[t].mean() > width / 2:
            t[:] = [copies.get(int(v), int(v)) for v in t]
    return np.array(material, np.float32), triangles


@unittest.skipUnless(CAPTURES.exists() and TRUTH.exists(), "the shared captures are not here")
class SimulatorsTear(RustleTest):
    def setUp(self):
        super().setUp()
        self.arrays = dict(np.load(CAPTURES / "arcsim_tear.npz"))
        self.truth = json.loads(TRUTH.read_text())
        self.times = self.arrays["times"]

    def local_edge_m(self, frame, place):
        """Mean length of the edges at the vertex nearest to a place in space."""
        a, b = self.arrays["vertex_offsets"][frame:frame + 2]
        x = self.arrays["positions"][a:b]
        a, b = self.arrays["triangle_offsets"][frame:frame + 2]
        around = self.arrays["triangles"][a:b]
        v = int(np.argmin(np.linalg.norm(x - place, axis=1)))
        others = np.setdiff1d(around[(around == v).any(1)], [v])
        return float(np.linalg.norm(x[others] - x[v], axis=1).mean())

    def render_tear(self, path, name):
        stems = self.folder / f"{name}_stems"
        # y is up in this capture; the importer turns it, so what it finds is turned back.
        rate, samples, events = self.render(self.import_npz(path, "--up", "y"), name, "--channels", "mono", "--stems", stems)
        sound = [read_wav(p)[1][:, 0] for p in sorted(stems.glob("*tearing*.wav"))]
        return rate, samples, tearing(events), sum(sound) if sound else np.zeros(len(samples))

    def per_frame(self, tears):
        """(length torn in each frame, places of the tips that go on in each)"""
        torn, tips = np.zeros(len(self.times)), [[] for _ in self.times]
        for event in tears:
            for time, speed, *place in event["track"]:
                frame = int(np.argmin(np.abs(self.times - time)))
                if speed <= 0:
                    continue
                torn[frame] += speed * (self.times[frame] - self.times[frame - 1])
                tips[frame].append(np.array([place[0], place[2], -place[1]]))
        return torn, tips

    def test_tips_length_and_parting(self):
        rate, samples, tears, sound = self.render_tear(CAPTURES / "arcsim_tear.npz", "tear")
        torn, tips = self.per_frame(tears)
        notch = self.truth[0]["crack_m"]
        truth = np.array([row["crack_m"] for row in self.truth])
        opening = int(np.argmax(truth > notch + 1e-3))
        parting = int(np.argmax([row["pieces"] == 2 for row in self.truth]))
        length = notch + np.cumsum(torn)
        print(f"{len(tears)} tips, torn {length[-1] * 1e3:.1f} mm of {truth[-1] * 1e3:.1f}, opens at {self.times[opening]:.3f} s, "
              f"parts at {self.times[parting]:.3f} s; worst length {np.max(np.abs(length / truth - 1)):.4f}")
        self.assertTrue(np.all(np.abs(length[opening:parting + 1] / truth[opening:parting + 1] - 1) < 0.1))
        self.assertEqual(torn[:opening].sum(), 0, "the notch sounds")
        self.assertEqual(torn[parting + 1:].sum(), 0, "it tears on after it has parted")
        furthest, count = 0.0, 0
        for frame in range(opening, parting):  # at the parting the tip has left the sheet
            if truth[frame] > truth[frame - 1] + 1e-4:
                self.assertTrue(tips[frame], f"no tip at {self.times[frame]} s")
            known = np.array(self.truth[frame]["tips_m"])
            for tip in tips[frame]:
                away, edge = np.linalg.norm(known - tip, axis=1).min(), self.local_edge_m(frame, tip)
                furthest, count = max(furthest, away / edge), count + 1
                self.assertLess(away, edge, f"a tip at {self.times[frame]} s")
        print(f"{count} times a tip went on, never further than {furthest:.3f} local edges from the truth's")
        self.assertEqual(sum(e["torn_m"] for e in tears) + notch, np.clip(sum(e["torn_m"] for e in tears) + notch, truth[-1] - 1e-3, truth[-1] + 1e-3))
        # The level follows the growth: RMS of the tearing and length torn, smoothed over a tenth of a second.
        hop = rate // 60
        level = np.sqrt([np.mean(sound[k * hop:(k + 1) * hop] ** 2) for k in range(len(self.times) - 1)])
        smooth = np.ones(6) / 6
        grows = np.convolve(torn, smooth, "same")[:len(level)]
        agreement = np.corrcoef(np.convolve(level, smooth, "same"), grows)[0, 1]
        print(f"level over growth correlates {agreement:.3f}; tearing {rms_dbfs(sound):.1f} dBFS in the mean")
        self.assertGreater(agreement, 0.85)
        first, last = int(self.times[opening - 1] * rate), int(self.times[parting + 1] * rate)
        self.assertEqual(np.abs(sound[:first]).max(), 0)
        self.assertEqual(np.abs(sound[last + rate // 20:]).max(), 0)
        self.assertGreater(rms_dbfs(sound[first:last]), -45)

    def test_remeshed_without_material_coordinates_nothing_tears(self):
        for name in ("arcsim_tear", "arcsim_crumple"):
            arrays = dict(np.load(CAPTURES / f"{name}.npz"))
            arrays.pop("material_coordinates")
            path = self.folder / f"{name}_bare.npz"
            np.savez(path, **arrays)
            _, _, events = self.render(self.import_npz(path), "bare")
            self.assertEqual(tearing(events), [])

    def test_no_other_capture_tears(self):
        for path in sorted(CAPTURES.glob("*.npz")):
            if path.stem == "arcsim_tear":
                continue
            with self.subTest(capture=path.stem):
                _, _, events = self.render(self.import_npz(path), path.stem)
                self.assertEqual(tearing(events), [])


class SentAndFound(RustleTest):
    FRAMES = 60

    def mesh_at(self, k, tears=True):
        cut = min(20, max(0, k - 5) // 2) if tears else 0
        return cut, torn_grid(0.1, 0.1, 10, 20, cut)

    def test_a_torn_grid_sounds_while_it_tears_and_its_pieces_sound_after(self):
        positions, offsets, triangles, triangle_offsets, material = [], [0], [], [0], []
        for k in range(self.FRAMES + 30):
            cut, (flat, faces) = self.mesh_at(k)
            part = 0.05 * max(0, k - self.FRAMES) / 60  # once in two, both halves slide over the table, apart
            side = np.sign(np.bincount(faces.ravel(), np.repeat(np.sign(flat[faces].mean(1)[:, 0] - 0.05), 3), len(flat)))
            x = np.stack([flat[:, 0] + 4 * part * side, flat[:, 1], np.full(len(flat), 0.001)], 1)
            positions.append(x)
            triangles.append(faces)
            material.append(flat)
            offsets.append(offsets[-1] + len(flat))
            triangle_offsets.append(triangle_offsets[-1] + len(faces))
        h = 2.0
        path = save_npz(self.folder / "grid.npz", np.concatenate(positions), np.concatenate(triangles), np.arange(len(positions)) / 60,
                        vertex_offsets=np.array(offsets), triangle_offsets=np.array(triangle_offsets), material_coordinates=np.concatenate(material),
                        obstacle0_vertices=np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]], np.float32),
                        obstacle0_triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
        rate, samples, events = self.render(self.import_npz(path), "grid", "--channels", "mono")
        tears = tearing(events)
        self.assertEqual(len(tears), 1)
        self.assertAlmostEqual(tears[0]["torn_m"], 0.1, delta=0.002)
        self.assertEqual(tears[0]["source"], "detected")
        self.assertAlmostEqual(tears[0]["time_s"], 6 / 60, delta=1.5 / 60)
        self.assertAlmostEqual(tears[0]["end_s"], 45 / 60, delta=1.5 / 60)
        self.assertGreater(rms_dbfs(samples[rate * 15 // 60:rate * 40 // 60]), -45)
        sliding = [e for e in events if e["kind"] == "friction" and e["end_s"] > (self.FRAMES + 10) / 60 and e["speed_m_per_s"] > 0.1]
        sides = {e["position_m"][0] > 0.05 for e in sliding}
        self.assertEqual(sides, {True, False}, "both pieces slide, each for itself")

    def test_sent_tips_sound(self):
        options = sdk.SessionOptions(name="tips", clock=sdk.Clock.SIMULATION, sheets=[sdk.SheetOptions(1)])
        with daemon(self.folder, "--device", "none") as ends, sdk.Connection.connect(ends["control"]) as connection:
            heard = {}
            for speed in (0.1, 0.2):
                with sdk.Session.attach(connection, options) as session:
                    session.set_gains([sdk.Gain(gain_db=-12)])  # far below the limiter
                    stem, mix = session.listen(stem=(1, sdk.SoundKind.TEARING)), session.listen()
                    material, triangles = grid(0.1, 0.1, 10, 10)
                    session.add_topology(1, triangles, material_coordinates=material)
                    flat = np.concatenate([material, np.zeros((len(material), 1), np.float32)], 1)
                    session.listener(0, (0.05, 0.05, 1.0))
                    for k in range(120):
                        tip = sdk.TearTip(3, (0.05, 0.01 + 0.0005 * k, 0), speed, (0, 1, 0))
                        session.frame(1, 1, k / 60, flat, tear_tips=[tip] if k < 90 else [])
                    session.end()
                    sound = stem.read_all().samples
                    heard[speed] = sound
                    np.testing.assert_array_equal(mix.read_all().samples, sound)
                    self.assertEqual(session.statistics().tear_events, 1)
            rate = 48000
            for speed, sound in heard.items():
                mono = sound[:, 0]
                self.assertGreater(rms_dbfs(mono[rate // 2:rate]), -48 + 20 * np.log10(speed / 0.1))
                self.assertEqual(np.abs(sound[int(1.6 * rate):]).max(), 0)
            self.assertAlmostEqual(rms_dbfs(heard[0.2][rate // 4:rate]) - rms_dbfs(heard[0.1][rate // 4:rate]), 6, delta=1.5)


if __name__ == "__main__":
    main()
