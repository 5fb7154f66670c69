#!/usr/bin/python3
"""`rustle load`: synthetic clients of a real daemon, whose figures add up."""
import json
import math
import unittest

from support import RustleTest, daemon, main, rustle


class Load(RustleTest):
    def load(self, *arguments):
        return json.loads(rustle("load", "--json", *arguments).stdout)

    def check_sums(self, crowd):
        self.assertTrue(crowd["sums_exact"])
        self.assertEqual(crowd["frames_received"], crowd["frames_analysed"] + sum(crowd["dropped"].values()))

    def test_figures_of_a_crowd(self):
        figures = self.load("--sessions", 3, "--fps", 60, "--triangles", 446, "--seconds", 3)
        self.check_sums(figures)
        self.assertEqual(figures["sessions"], 3)
        self.assertEqual(figures["frames_sent"], figures["frames_received"])
        self.assertAlmostEqual(figures["frames_sent"], 3 * 60 * 4, delta=60)  # a second of warming up
        latency = figures["latency_ms"]
        self.assertGreaterEqual(latency["p50"], figures["playout_delay_ms"])
        self.assertLessEqual(latency["p50"], latency["p99"])
        self.assertLessEqual(latency["p99"], latency["p999"])
        self.assertGreater(figures["cpu_s_per_session_s"], 0)
        self.assertLess(figures["longest_silence_s"], 0.5)
        for name in ("deadline_misses", "late_by_run_delay", "pcm_gaps"):
            self.assertIsInstance(figures[name], int)

    def test_frames_that_are_withheld_and_clients_that_vanish(self):
        figures = self.load("--sessions", 4, "--triangles", 183, "--seconds", 4, "--withheld", 0.1, "--jitter-ms", 10,
                            "--vanish-every", 1.5)
        self.check_sums(figures)
        self.assertEqual(figures["vanished"], 2)
        self.assertEqual(figures["refused"], 0)
        self.assertLess(figures["frames_sent"], 0.97 * 4 * 60 * 5)

    def test_a_surge_sends_more(self):
        calm = self.load("--sessions", 2, "--triangles", 183, "--seconds", 3)
        surge = self.load("--sessions", 2, "--triangles", 183, "--seconds", 3, "--surge", "2:0:3")
        self.check_sums(surge)
        self.assertGreater(surge["frames_sent"], 1.5 * calm["frames_sent"])

    def test_heavy_ones_are_told_apart(self):
        figures = self.load("--sessions", 2, "--triangles", 183, "--seconds", 3, "--heavy", 1, "--heavy-triangles", 446,
                            "--heavy-fps", 120, "--sheets", "slide")
        self.check_sums(figures)
        self.check_sums(figures["heavy"])
        self.assertEqual(figures["heavy"]["sessions"], 1)
        self.assertAlmostEqual(figures["heavy"]["frames_sent"], 120 * 4, delta=60)

    def test_an_overloaded_daemon_does_without_some_quality_and_has_it_back(self):
        core = ("--daemon-cpus", 0, "--triangles", 5000)
        cost = self.load("--sessions", 4, "--seconds", 3, *core)["cpu_s_per_session_s"]
        sessions = max(2, math.ceil(0.45 / cost))  # half a core, then one and a half
        for surge in (3, 6, 12):  # the cost was measured beside whatever else the machine was doing
            figures = self.load("--sessions", sessions, "--seconds", 24, "--surge", f"{surge}:2:11", *core)
            self.check_sums(figures)
            self.assertEqual(figures["sessions"], sessions)
            if figures["load_level_most"] > 0:
                break
        self.assertGreaterEqual(figures["load_level_most"], 1)
        self.assertLessEqual(figures["full_quality_after_s"], 10)
        self.assertLess(figures["longest_silence_s"], 1)

    def test_a_session_beyond_its_budget_is_throttled_and_told(self):
        calm = ("--sessions", 2, "--triangles", 183, "--seconds", 4)
        with daemon(self.folder, "--budget-megabytes", 2, log=self.folder / "log") as ends:
            figures = self.load(*calm, "--heavy", 1, "--heavy-triangles", 2000, "--heavy-fps", 600, "--control", ends["control"])
        self.assertIn("sends more than 2 MB a second", (self.folder / "log").read_text())
        self.check_sums(figures)
        self.check_sums(figures["heavy"])
        self.assertEqual(figures["dropped"].get("budget", 0), 0)
        heavy = figures["heavy"]
        frame_bytes = 12 * 1050
        self.assertGreater(heavy["dropped"]["budget"], 0.5 * heavy["frames_received"])
        self.assertAlmostEqual(heavy["frames_analysed"] / (2e6 * 5.5 / frame_bytes), 1, delta=0.3)

    def test_sheets_that_are_torn(self):
        figures = self.load("--kind", "tear", "--sessions", 2, "--triangles", 183, "--seconds", 4)
        self.check_sums(figures)
        self.assertEqual(figures["frames_sent"], figures["frames_received"])
        self.assertEqual(figures["refused"], 0)
        self.assertAlmostEqual(figures["frames_sent"], 2 * 60 * 5, delta=60)
        self.assertEqual(figures["dropped"], {})

    def test_wrong_usage_names_the_remedy(self):
        for arguments, words in ((("--sheets", "wave"), "crumple slide tear"), (("--surge", "much"), "2:10:20"),
                                 (("--sessions", "0"), "--sessions"),
                                 (("--control", "ipc:///nowhere", "--daemon-cpus", "0"), "leave --control out")):
            refused = rustle("load", *arguments, status=2)
            self.assertIn(words, refused.stderr + refused.stdout)


if __name__ == "__main__":
    main()
