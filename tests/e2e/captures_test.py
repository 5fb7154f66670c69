#!/usr/bin/python3
"""Real simulator output from import to sound. The shared captures are used where they are; the stored one always."""
import json
import unittest

import numpy as np

from support import SHARED, STORED_CAPTURE, RustleTest, main, rms_dbfs

CAPTURES = sorted((SHARED / "captures").glob("*.npz"))


class StoredCapture(RustleTest):
    def test_version_1_still_renders(self):
        rate, samples, events = self.render(STORED_CAPTURE)
        self.assertTrue(np.isfinite(samples).all())
        self.assertGreater(np.abs(samples).max(), 1e-3)
        self.assertTrue(any(e["kind"] == "crumpling" for e in events))
        self.assertTrue(any(e["kind"] == "friction" for e in events))


@unittest.skipUnless(CAPTURES, "the shared captures are not here")
class SharedCaptures(RustleTest):
    def largest_expected(self, name, count=10):
        expected = json.loads((SHARED / f"reference/expected/{name}.events.json").read_text())
        column = expected["columns"].index
        rows = sorted(expected["largest_400"], key=lambda r: -r[column("amplitude_m")])[:count]
        return expected, [r[column("time_s")] for r in rows]

    def test_every_capture(self):
        for path in CAPTURES:
            with self.subTest(capture=path.stem):
                capture = self.import_npz(path)
                rate, samples, events = self.render(capture, path.stem)
                self.assertTrue(np.isfinite(samples).all())
                self.assertLessEqual(np.abs(samples).max(), 1.0)
                crumpling = [e for e in events if e["kind"] == "crumpling"]
                expected, times = self.largest_expected(path.stem)
                print(path.stem, "events", len(crumpling), "of", expected["total_events"],
                      "amplitude %.2f of %.2f" % (sum(e["amplitude"] for e in crumpling), expected["total_amplitude"]),
                      "friction", sum(e["kind"] == "friction" for e in events), "level %.1f dBFS" % rms_dbfs(samples))
                if path.stem.startswith("blender"):
                    start = np.load(path)["times"][0]
                    for time in times:
                        first = int((time - start) * rate)
                        self.assertGreater(rms_dbfs(samples[first:first + rate // 10]), -60, f"after the event at {time} s")
                    self.assertLess(len(crumpling), 1.5 * expected["total_events"])
                    self.assertGreater(len(crumpling), expected["total_events"] / 1.5)
                else:
                    self.assertLess(len(crumpling), 3 * expected["total_events"] + 10, "a burst of false events")

    def test_sliding_is_heard(self):
        for name in ("blender_table", "blender_cotton"):
            with self.subTest(capture=name):
                rate, samples, events = self.render(self.import_npz(SHARED / f"captures/{name}.npz"), name)
                episodes = [e for e in events if e["kind"] == "friction" and e["speed_m_per_s"] > 0.05]
                self.assertTrue(episodes)
                longest = max(episodes, key=lambda e: e["end_s"] - e["time_s"])
                start = np.load(SHARED / f"captures/{name}.npz")["times"][0]
                a, b = (int((longest[k] - start) * rate) for k in ("time_s", "end_s"))
                self.assertGreater(rms_dbfs(samples[a:b]), -60)

    def test_a_sheet_at_rest_falls_silent(self):
        for name in ("blender_crumple", "blender_table"):
            with self.subTest(capture=name):
                data = dict(np.load(SHARED / f"captures/{name}.npz"))
                step = np.diff(data["times"]).mean()
                more = int(2 / step)
                data["positions"] = np.concatenate([data["positions"], np.repeat(data["positions"][-1:], more, 0)])
                data["times"] = np.concatenate([data["times"], data["times"][-1] + step * np.arange(1, more + 1)])
                np.savez(self.folder / "longer.npz", **data)
                rate, samples, _ = self.render(self.import_npz(self.folder / "longer.npz"))
                end = int((data["times"][-1] - data["times"][0]) * rate)
                self.assertLess(rms_dbfs(samples[end - rate // 4:end]), -90)


if __name__ == "__main__":
    main()
