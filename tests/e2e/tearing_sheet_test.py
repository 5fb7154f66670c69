#!/usr/bin/python3
"""A sheet that is torn: `rustle demo tear` through the sockets, its capture, and the example whose hands an application moves."""
import json
import subprocess

import numpy as np

from support import BIN, RustleTest, daemon, main, read_wav, rms_dbfs, rustle

EXAMPLE = BIN / "examples/tear_by_hand"


class Demo(RustleTest):
    def demo(self, name, *options):
        out = self.folder / name
        rustle("demo", "tear_fast", "--triangles", 300, "-o", out, "--capture", f"{out}.mcap", *options)
        rate, samples = read_wav(f"{out}.wav")
        return rate, samples, out

    def test_a_sheet_is_torn_in_two(self):
        rate, samples, out = self.demo("torn")
        self.assertGreater(len(samples) / rate, 3.9)
        self.assertTrue(np.isfinite(samples).all())
        self.assertGreater(rms_dbfs(samples), -80)
        self.assertTrue(out.with_suffix(".png").exists())
        film = json.loads(rustle("inspect", f"{out}.mcap", "--film", 6, "--json", "-o", self.folder / "film.png").stdout)
        triangles = [frame["triangles"] for frame in film["frames"]]
        self.assertEqual(triangles, sorted(triangles))
        self.assertGreater(triangles[-1], triangles[0] + 200)

    def test_its_capture_gives_the_same_samples(self):
        _, samples, out = self.demo("torn")
        _, again, _ = self.render(f"{out}.mcap", "again")
        self.assertTrue(np.array_equal(samples, again))

    def test_tips_are_sent_or_left_out(self):
        captures = []
        for tips in ("sent", "sent", "found"):
            _, _, out = self.demo("torn", "--tips", tips)
            captures.append(out.with_suffix(".mcap").read_bytes())
        self.assertEqual(captures[0], captures[1])
        self.assertNotEqual(captures[0], captures[2])
        refused = rustle("demo", "tear", "--tips", "guessed", status=2)
        self.assertIn("--tips", refused.stderr + refused.stdout)


class ByHand(RustleTest):
    """client_sdk/examples/tear_by_hand."""

    def tear(self, lines, *options, status=0):
        with daemon(self.folder) as ends:
            done = subprocess.run([EXAMPLE, "--control", ends["control"], *options], input="\n".join(lines), text=True,
                                  capture_output=True, timeout=120)
        self.assertEqual(done.returncode, status, done.stderr)
        return [json.loads(line) for line in done.stdout.splitlines()], done.stderr

    def test_hands_tear_a_sheet_as_lines_tell_them(self):
        stroke = ["turn 0.32 0.32 0.3", "grip 0.2"]
        told, _ = self.tear(stroke * 6 + ["wait 0.2", "new", "turn 0.2 0 0.3"])
        *actions, end = told
        torn = [action["torn_m"] for action in actions[:12]]
        self.assertEqual(torn, sorted(torn))
        self.assertGreater(torn[0], 0.02)
        self.assertGreater(actions[0]["height_m"], 0.005)
        self.assertTrue(actions[11]["separated"])
        self.assertFalse(actions[-1]["separated"])
        self.assertLess(actions[-1]["torn_m"], torn[1])
        self.assertEqual((end["frames"], end["refused"]), (end["analysed"], 0))
        self.assertGreater(end["topologies"], 60)

    def test_a_line_that_is_no_action_is_told_and_left_out(self):
        told, said = self.tear(["twist 1", "turn 0.1 nan 1", "turn 0.1 0.1 0.2"], "--tips", "found")
        self.assertEqual(len(told), 2)
        self.assertIn('no action: "twist 1"', said)
        self.assertIn('no action: "turn 0.1 nan 1"', said)


if __name__ == "__main__":
    main()
