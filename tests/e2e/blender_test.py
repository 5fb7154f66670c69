#!/usr/bin/python3
"""The Blender add-on in a Blender without a window: a real cloth simulation over the real network. tests/blender/run.sh installs
Blender and runs this."""
import json
import shutil
import subprocess
import unittest

import numpy as np

from support import SOURCE, RustleTest, daemon, main, read_wav, rms_dbfs
from support import rustle as run_rustle


@unittest.skipUnless(shutil.which("blender"), "Blender is not installed: tests/blender/run.sh installs it and runs this")
class Blender(RustleTest):
    def run_blender(self, script, ends, *arguments):
        """What the script, run inside Blender, wrote as JSON."""
        subprocess.run([SOURCE / "client_sdk/blender/package.sh", self.folder / "addon"], check=True, capture_output=True)
        (self.folder / "scripts").mkdir()
        told = self.folder / "told.json"
        environment = {"PATH": "/usr/bin:/bin", "HOME": str(self.folder), "BLENDER_USER_SCRIPTS": str(self.folder / "scripts"), "OMP_NUM_THREADS": "1"}
        done = subprocess.run(["blender", "-b", "--factory-startup", "-noaudio", "--python-exit-code", "3", "--python", SOURCE / "tests/blender" / script,
                               "--", self.folder / "addon/rustle_blender.zip", ends["control"], told, *arguments],
                              env=environment, capture_output=True, text=True, timeout=600)
        self.assertEqual(done.returncode, 0, done.stdout[-4000:] + done.stderr[-4000:])
        return json.loads(told.read_text())

    def test_a_sheet_is_shaken_and_crumpled_live(self):
        wav = self.folder / "live.wav"
        with daemon(self.folder, "--device", "none") as ends:
            told = self.run_blender("live.py", ends, wav)
        self.assertEqual((told["shown"], told["refused"]), (120, 0))
        self.assertEqual(told["frames_received"], told["frames_analysed"] + sum(told["dropped"].values()))
        self.assertGreater(told["frames_analysed"], 100)
        self.assertGreater(told["crumpling"], 20)
        rate, samples = read_wav(wav)
        for begin, end in ((0.3, 1.0), (1.0, 1.9)):  # shaken; crumpled
            self.assertGreater(rms_dbfs(samples[int(begin * rate):int(end * rate)]), -60)
        self.assertFalse(told["still_running"])
        self.assertIn("detached", told["trouble"])
        print(f"\nframe hook at {told['hook_vertices']} vertices: {told['hook_processor_ms']:.3f} ms of a processor, {told['hook_ms']:.3f} ms by the clock (medians)")

    def test_an_animation_is_baked_into_the_sequencer(self):
        with daemon(self.folder, "--device", "none", "--recordings", self.folder / "takes", "--record-all") as ends:
            told = self.run_blender("bake.py", ends, self.folder)
        self.assertEqual(told["results"], [["FINISHED"], ["FINISHED"]])
        strip, = told["strips"]
        baked = self.folder / "baked.wav"
        self.assertEqual((strip["name"], strip["channel"], strip["start"], strip["path"]), ("Rustle sheet", 2, 1, str(baked)))
        self.assertEqual((told["sounds"], told["frame"]), (1, 7))
        rate, samples = read_wav(baked)
        self.assertGreater(rms_dbfs(samples), -60)
        self.assertAlmostEqual(strip["frames"], 30 * len(samples) / rate, delta=1)
        takes = sorted((self.folder / "takes").glob("*.mcap"), key=lambda path: path.stat().st_mtime)
        run_rustle("render", takes[-1], "-o", self.folder / "rendered.wav")
        np.testing.assert_array_equal(samples.astype(np.float32), read_wav(self.folder / "rendered.wav")[1].astype(np.float32))

        refused, cancelled = told["refused"], told["cancelled"]
        self.assertIn("Save it", refused["unsaved"])
        self.assertIn("Pick a mesh object", refused["sheet"])
        self.assertIn("Start rustled", refused["daemon"])
        self.assertIn("lead", refused["material"])
        self.assertIn("missing is not there", refused["folder"])
        self.assertIn("within 3 mm", refused["hint"])
        self.assertEqual(refused["ask"], ["FINISHED"])
        self.assertAlmostEqual(cancelled.pop("progress"), 10 / 48)
        self.assertEqual(cancelled, {"frame": 7, "done": True, "strips": 0, "file": False})


if __name__ == "__main__":
    main()
