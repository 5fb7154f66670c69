#!/usr/bin/python3
"""rustled as a service: what it tells its manager, and how little the unit lets it do."""
import os
import re
import shutil
import signal
import socket
import subprocess
import time
import unittest

from support import BIN, BUILD, SOURCE, RustleTest, daemon, main

UNIT = SOURCE / "deploy/systemd/rustled.service"


class Service(RustleTest):
    def listen_as_manager(self, watchdog_s):
        heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        heard.bind(str(self.folder / "notify"))
        heard.settimeout(10)
        self.addCleanup(heard.close)
        for name, value in (("NOTIFY_SOCKET", str(self.folder / "notify")), ("WATCHDOG_USEC", str(int(1e6 * watchdog_s)))):
            os.environ[name] = value
            self.addCleanup(os.environ.pop, name)
        return heard

    def test_manager_hears_of_start_life_and_end(self):
        heard = self.listen_as_manager(0.5)
        with daemon(self.folder) as ends:
            self.assertIn("READY=1", heard.recv(512).decode().split("\n"))
            began = time.monotonic()
            for _ in range(4):
                self.assertEqual(heard.recv(512).decode(), "WATCHDOG=1")
            self.assertGreater(time.monotonic() - began, 0.6)  # twice in the watchdog's time, not all the time
            ends["process"].send_signal(signal.SIGSTOP)
            time.sleep(0.1)
            heard.settimeout(0)
            with self.assertRaises(BlockingIOError):
                while True:
                    heard.recv(512)
            heard.settimeout(1)
            with self.assertRaises(TimeoutError):
                heard.recv(512)
            ends["process"].send_signal(signal.SIGCONT)
            heard.settimeout(10)
            self.assertEqual(heard.recv(512).decode(), "WATCHDOG=1")
            ends["process"].send_signal(signal.SIGTERM)
            said = ""
            while said != "STOPPING=1":
                said = heard.recv(512).decode()

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd is not installed")
    def test_unit_grants_little(self):
        told = subprocess.run(["systemd-analyze", "security", "--offline=true", "--no-pager", UNIT], capture_output=True, text=True)
        level = re.search(r"Overall exposure level for rustled.service: ([0-9.]+)", told.stdout)
        self.assertTrue(level, told.stdout + told.stderr)
        self.assertLessEqual(float(level[1]), 2.0)

    def test_units_command_is_one_that_rustled_takes(self):
        """With the configuration that comes with it, which plays on no device and may be recorded into the service's folder."""
        command = re.search(r"^ExecStart=/usr/bin/rustled (.*)$", UNIT.read_text(), re.M)[1]
        self.assertIn("/etc/rustle/rustled.toml", command)
        said = (BUILD / "manual/rustled.toml").read_text()
        self.assertIn("/var/lib/rustle/", said)
        self.assertRegex(UNIT.read_text(), r"(?m)^StateDirectory=rustle$")
        (self.folder / "rustled.toml").write_text(said.replace("/var/lib/rustle", str(self.folder)))
        words = command.replace("/etc/rustle", str(self.folder)).split()
        in_force = subprocess.run([BIN / "rustled", *words, "--print-config"], capture_output=True, text=True, timeout=60).stdout
        self.assertIn(f"folder = '{self.folder}/recordings'", in_force)
        with daemon(self.folder, *words) as ends:
            self.assertIsNone(ends["process"].poll())


if __name__ == "__main__":
    main()
