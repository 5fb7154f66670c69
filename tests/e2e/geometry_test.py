#!/usr/bin/python3
"""What geometry finds in real simulator output: events and regions of the shared captures beside the stored lists of the
reference implementation."""
import json
import unittest

import numpy as np

from support import SHARED, RustleTest, main, rustle

CAPTURES = SHARED / "captures"
EXPECTED = SHARED / "reference/expected"


@unittest.skipUnless(CAPTURES.exists() and EXPECTED.exists(), "the shared captures are not here")
class SharedCaptures(RustleTest):
    rendered = {}

    def crumpling_of(self, name):
        """(our events, the reference's list, frame times)"""
        if name not in self.rendered:
            _, _, events = self.render(self.import_npz(CAPTURES / f"{name}.npz"), name)
            self.rendered[name] = [e for e in events if e["kind"] == "crumpling"]
        expected = json.loads((EXPECTED / f"{name}.events.json").read_text())
        return self.rendered[name], expected, np.load(CAPTURES / f"{name}.npz")["times"]

    def regions_at(self, capture, time_s):
        """Regions at that time, largest first."""
        shown = json.loads(rustle("inspect", capture, "--time", time_s, "--json").stdout)
        return sorted(shown["regions"], key=lambda r: -r["area_m2"])

    def assert_within_factor(self, ours, theirs, factor, what):
        self.assertLess(max(ours, theirs), factor * min(ours, theirs), f"{what}: {ours:.4g} beside {theirs:.4g}")

    def test_events_agree_in_rate_level_time_and_place(self):
        for name in ("blender_shake", "blender_table", "blender_crumple", "blender_cotton"):
            with self.subTest(capture=name):
                ours, expected, _ = self.crumpling_of(name)
                level = sum(e["amplitude"] for e in ours)
                column = expected["columns"].index
                largest = sorted(expected["largest_400"], key=lambda r: -r[column("amplitude_m")])[:20]
                times = np.array([e["time_s"] for e in ours])
                places = np.array([e["position_m"] for e in ours])
                met = 0
                for row in largest:
                    near = np.abs(times - row[column("time_s")]) < 1 / 60
                    place = np.array([row[column(axis)] for axis in "xyz"])
                    met += bool((np.linalg.norm(places[near] - place, axis=1) < 0.03).any())
                print(f"{name}: {len(ours)} events beside {expected['total_events']}, amplitude {level:.2f} beside "
                      f"{expected['total_amplitude']:.2f}, {met} of the 20 largest met in time and place")
                self.assert_within_factor(len(ours), expected["total_events"], 1.5, "events")
                self.assert_within_factor(level, expected["total_amplitude"], 1.5, "summed amplitude")
                self.assertGreaterEqual(met, 16)

    def test_events_follow_the_motion(self):
        for name in ("blender_shake", "blender_table", "blender_crumple", "blender_cotton"):
            with self.subTest(capture=name):
                ours, expected, frame_times = self.crumpling_of(name)
                frames = len(expected["per_frame_amplitude"])
                theirs = np.array(expected["per_frame_amplitude"])
                at = np.clip(np.searchsorted(frame_times, [e["time_s"] for e in ours]), 0, frames - 1)
                per_frame = np.bincount(at, [e["amplitude"] for e in ours], frames)
                smooth = np.ones(15) / 15  # a quarter of a second
                agreement = np.corrcoef(np.convolve(per_frame, smooth, "same"), np.convolve(theirs, smooth, "same"))[0, 1]
                print(f"{name}: amplitude over time correlates {agreement:.3f}")
                self.assertGreater(agreement, 0.9)

    def test_a_sheet_crushed_to_a_ball(self):
        name = "arcsim_crumple"
        ours, expected, times = self.crumpling_of(name)
        print(f"{name}: {len(ours)} events beside {expected['total_events']}, amplitude "
              f"{sum(e['amplitude'] for e in ours):.4f} beside {expected['total_amplitude']:.4f}")
        self.assertTrue(ours)
        self.assertGreaterEqual(min(e["time_s"] for e in ours), times[12], "an event before the sheet is touched")
        self.assert_within_factor(len(ours), expected["total_events"], 1.5, "events")
        self.assert_within_factor(sum(e["amplitude"] for e in ours), expected["total_amplitude"], 1.5, "summed amplitude")
        capture = self.import_npz(CAPTURES / f"{name}.npz")
        counts = []
        for frame in json.loads((EXPECTED / f"{name}.regions.json").read_text())["frames"]:
            regions = self.regions_at(capture, times[frame["frame"]])
            counts.append(len(regions))
            print(f"{name} frame {frame['frame']}: {len(regions)} regions beside {frame['regions']}, the largest "
                  f"{regions[0]['area_m2'] * 1e4:.1f} cm2 beside {frame['largest'][0]['area'] * 1e4:.1f}")
        self.assertLess(counts[0], 10)
        self.assertGreater(counts[-1], 10 * counts[0], "the crushed sheet does not break into facets")
        for time in times[-20::4]:
            self.assertTrue(self.regions_at(capture, time)[0]["constrained"], f"the largest at {time} s")

    def test_tearing_makes_no_burst(self):
        ours, expected, _ = self.crumpling_of("arcsim_tear")
        print(f"arcsim_tear: {len(ours)} events beside {expected['total_events']}, amplitude "
              f"{sum(e['amplitude'] for e in ours):.4f} beside {expected['total_amplitude']:.4f}")
        self.assert_within_factor(len(ours), expected["total_events"], 1.5, "events")
        self.assert_within_factor(sum(e["amplitude"] for e in ours), expected["total_amplitude"], 1.5, "summed amplitude")


if __name__ == "__main__":
    main()
