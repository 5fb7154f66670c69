#!/usr/bin/python3
"""README.md's ten lines in each language, as they stand, against a daemon started as README says."""
import os
import socket
import subprocess
import sys

from support import BIN, BUILD, SOURCE, RustleTest, main, wait_until

sys.path.insert(0, str(SOURCE / "tests/support"))
from readme_example import example

PORTS = (7390, 7391, 7392)


def taken(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


class TenLines(RustleTest):
    def setUp(self):
        super().setUp()
        wait_until(lambda: not any(map(taken, PORTS)), 60, f"another program listens at one of the ports {PORTS}")
        process = subprocess.Popen([BIN / "rustled", "--log-level", "error"])
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        wait_until(lambda: all(map(taken, PORTS)), 20, "rustled did not start at its default endpoints")

    def run_program(self, *arguments, **options):
        done = subprocess.run(arguments, cwd=self.folder, capture_output=True, text=True, timeout=120, **options)
        self.assertEqual((done.returncode, done.stderr), (0, ""), done.stdout)

    def test_python(self):
        (self.folder / "example.py").write_text(example(SOURCE / "README.md", "python"))
        check = "import numpy, runpy; sound = runpy.run_path('example.py')['sound']; assert numpy.abs(sound.samples).max() > 1e-3, sound"
        self.run_program(sys.executable, "-c", check, env={**os.environ, "PYTHONPATH": str(BUILD / "python")})

    def test_cpp(self):
        self.run_program(BUILD / "tests/readme_example")


if __name__ == "__main__":
    main()
