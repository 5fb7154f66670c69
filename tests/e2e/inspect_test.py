#!/usr/bin/python3
"""`rustle inspect`: one frame and a film of several, what they tell as JSON, and wrong usage."""
import json

import numpy as np

from support import STORED_CAPTURE, RustleTest, bent, curvature_of, grid, main, read_wav, rustle, save_npz, table


def png_size(path):
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n" and data[12:16] == b"IHDR", f"{path} is no PNG"
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


class Inspect(RustleTest):
    def reversing(self):
        """A 20 x 15 cm sheet in the air, bent one way, then the other from 0.5 s on, in 61 frames of 1/60 s."""
        material, triangles = grid(0.20, 0.15, 20, 15)
        times = np.arange(61) / 60
        frames = []
        for t in times:
            bend = np.clip((0.5 - t) / 0.1, -1, 1) * curvature_of(0.20, 0.05)
            frames.append(bent(material, bend) + [0, 0, 1])
        path = save_npz(self.folder / "reversing.npz", frames, triangles, times, material_coordinates=material)
        return self.import_npz(path), times

    def resting(self):
        """An arched sheet that stands on a table with two edges for 0.3 s, then slides along them."""
        material, triangles = grid(0.20, 0.15, 20, 15)
        times = np.arange(37) / 60
        arch = bent(material, curvature_of(0.20, 0.1))
        frames = [arch + [0, 0.5 * max(0.0, t - 0.3), 0.0005] for t in times]
        path = save_npz(self.folder / "resting.npz", frames, triangles, times, material_coordinates=material, **table())
        return self.import_npz(path)

    def told(self, *arguments):
        return json.loads(rustle("inspect", *arguments, "--json").stdout)


class Film(Inspect):
    def test_frames_spread_over_the_capture(self):
        capture, times = self.reversing()
        picture = self.folder / "film.png"
        film = self.told(capture, "--film", 6, "--columns", 3, "-o", picture)
        shown = [frame["time_s"] for frame in film["frames"]]
        self.assertEqual(len(shown), 6)
        np.testing.assert_allclose(shown, np.linspace(0, 1, 6), atol=0.5 / 60 + 1e-9)
        self.assertEqual((film["from_s"], film["to_s"]), (0, 1))
        width, height = png_size(picture)
        self.assertTrue(1390 <= width <= 1400, width)
        self.assertGreater(height, 400)
        wider, _ = png_size(self.film_of(capture, "--film", 12, "--columns", 12))
        self.assertGreater(wider, width)

    def film_of(self, capture, *arguments):
        picture = self.folder / "other.png"
        rustle("inspect", capture, *arguments, "-o", picture)
        return picture

    def test_every_event_is_told_once(self):
        capture, _ = self.reversing()
        _, _, events = self.render(capture)
        crumpling = [e for e in events if e["kind"] == "crumpling"]
        self.assertTrue(crumpling)
        for count in (1, 2, 5, 61, 100):
            film = self.told(capture, "--film", count, *(() if count > 1 else ("--from", 0.9, "--to", 1.0)))
            told = sum(frame["events"] for frame in film["frames"])
            self.assertEqual(told, 0 if count == 1 else len(crumpling), f"--film {count}")
            self.assertEqual(len(film["frames"]), min(count, 61))
        film = self.told(capture, "--film", 5)
        self.assertEqual([frame["events"] > 0 for frame in film["frames"]].index(True), 3, "the sheet turns after 0.5 s")

    def test_each_frame_is_what_time_shows(self):
        for capture in (self.reversing()[0], self.resting()):
            for frame in self.told(capture, "--film", 5)["frames"]:
                alone = self.told(capture, "--time", frame["time_s"])
                self.assertEqual(frame["time_s"], alone["time_s"])
                self.assertEqual(frame["regions"], len(alone["regions"]))
                self.assertEqual(frame["coarse_regions"], sum(r["coarse"] for r in alone["regions"]))
                for name in ("triangles", "ridge_triangles", "touching_vertices", "sliding_contacts"):
                    self.assertEqual(frame[name], alone[name], f"{name} at {frame['time_s']} s")

    def test_a_part_of_the_time(self):
        capture, times = self.reversing()
        film = self.told(capture, "--film", 4, "--from", 0.25, "--to", 0.75)
        shown = [frame["time_s"] for frame in film["frames"]]
        np.testing.assert_allclose(shown, np.linspace(0.25, 0.75, 4), atol=0.5 / 60 + 1e-9)
        one = self.told(capture, "--film", 1)["frames"]
        np.testing.assert_allclose([frame["time_s"] for frame in one], [0.5], atol=0.5 / 60 + 1e-9)

    def test_people_are_told_too(self):
        capture, _ = self.reversing()
        done = rustle("inspect", capture, "--film", 3)
        self.assertEqual(len(done.stdout.splitlines()), 4)
        self.assertIn("3 frames of 61", done.stdout)
        self.assertEqual(done.stderr, "", "progress is for terminals")

    def test_the_same_bytes_again(self):
        capture, _ = self.reversing()
        first = self.film_of(capture, "--film", 4).read_bytes()
        self.assertEqual(first, self.film_of(capture, "--film", 4).read_bytes())


class Moment(Inspect):
    def test_contacts_hold(self):
        capture = self.resting()
        resting, sliding = self.told(capture, "--time", 0.2), self.told(capture, "--time", 0.55)
        for shown in (resting, sliding):
            self.assertGreaterEqual(shown["touching_vertices"], 32)
            largest = max(shown["regions"], key=lambda r: r["area_m2"])
            self.assertTrue(largest["curved"])
            self.assertFalse(largest["constrained"])
            self.assertAlmostEqual(largest["l_c_m"], 0.40, delta=0.004, msg="a border that rises from the table is free")
        self.assertEqual(resting["sliding_contacts"], 0)
        self.assertGreater(sliding["sliding_contacts"], 0)

    def test_picture(self):
        capture, _ = self.reversing()
        picture = self.folder / "frame.png"
        rustle("inspect", capture, "--time", 0.6, "-o", picture)
        self.assertEqual(png_size(picture), (1400, 860))


class Demo(RustleTest):
    def test_the_capture_of_a_demo_is_what_was_heard(self):
        capture = self.folder / "snap.mcap"
        rustle("demo", "snap", "--triangles", 200, "-o", self.folder / "snap", "--capture", capture)
        rate, samples, _ = self.render(capture)
        heard_rate, heard = read_wav(self.folder / "snap.wav")
        self.assertEqual(rate, heard_rate)
        np.testing.assert_array_equal(samples, heard)
        picture = self.folder / "film.png"
        rustle("inspect", capture, "--film", 3, "-o", picture)
        png_size(picture)


class WrongUsage(RustleTest):
    def complaint(self, status, *arguments):
        return rustle("inspect", STORED_CAPTURE, *arguments, status=status).stderr

    def test_one_frame_or_a_film(self):
        both = self.complaint(2, "--film", 3, "--time", 0.5)
        self.assertIn("leave one of them out", both)
        neither = self.complaint(2)
        self.assertIn("--time S", neither)
        self.assertIn("--film N", neither)

    def test_counts(self):
        for count in (0, -3, 101):
            self.assertIn("1 to 100", self.complaint(2, "--film", count))
        for columns in (0, 21):
            self.assertIn("1 to 20", self.complaint(2, "--film", 3, "--columns", columns))
        self.complaint(2, "--film", "many")

    def test_what_belongs_to_films(self):
        for option in ("--from", "--to", "--columns"):
            self.assertIn("add --film", self.complaint(2, "--time", 0.5, option, 1))

    def test_times(self):
        self.assertIn("exchange", self.complaint(2, "--film", 3, "--from", 2, "--to", 1))
        self.assertIn("--time 1.5", self.complaint(2, "--time", "nan"))
        text = self.complaint(1, "--film", 3, "--from", 1000)
        self.assertIn("its frames are from", text)
        self.assertIn("its first is at", self.complaint(1, "--time", -1000))

    def test_sheets_and_files(self):
        for moment in (("--film", 3), ("--time", 1000)):
            self.assertIn("--sheet: ", self.complaint(1, *moment, "--sheet", 77))
        text = self.complaint(2, "--film", 3, "-o", STORED_CAPTURE)
        self.assertIn("would be overwritten", text)
        self.assertIn("/no/folder", self.complaint(1, "--film", 3, "-o", "/no/folder/film.png"))

    def test_a_cut_capture_is_told(self):
        cut = self.folder / "cut.mcap"
        whole = STORED_CAPTURE.read_bytes()
        cut.write_bytes(whole[:len(whole) * 6 // 10])
        done = rustle("inspect", cut, "--film", 3, status=1)
        self.assertIn("cut.mcap", done.stderr)
        self.assertTrue(done.stdout)


if __name__ == "__main__":
    main()
