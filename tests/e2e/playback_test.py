#!/usr/bin/python3
"""Playback without hardware: what PulseAudio's null sink and JACK's dummy driver get is what was rendered; a sound server
that dies is survived by what is streamed, and played on again when it is back."""
import contextlib
import datetime
import os
import re
import shutil
import signal
import subprocess
import threading
import time
import unittest

import numpy as np

from support import BIN, STORED_CAPTURE, RustleTest, daemon, main, read_wav, rustle, wait_until

RATE = 48000
NULL_SINK = "module-null-sink sink_name=ci rate=48000 format=float32le channels=2 norewinds=1"


def missing(*programs):
    return [program for program in programs if shutil.which(program) is None]


class PulseServer:
    """A sound server of the test's own with a sink that leads nowhere but to its monitor."""

    def __init__(self, folder):
        self.folder = folder / "pulse"
        self.folder.mkdir(mode=0o700)
        self.environment = {"XDG_RUNTIME_DIR": str(self.folder), "PULSE_RUNTIME_PATH": str(self.folder),
                            "PULSE_SERVER": f"unix:{self.folder}/native", "HOME": str(self.folder), "PULSE_LATENCY_MSEC": "40"}
        self.process = None

    def start(self):
        self.process = subprocess.Popen(
            ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no", "--disallow-exit",
             "-L", f"module-native-protocol-unix auth-anonymous=1 socket={self.folder}/native", "-L", NULL_SINK],
            env={**os.environ, **self.environment}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 20
        while subprocess.run(["pactl", "info"], env={**os.environ, **self.environment}, capture_output=True).returncode != 0:
            assert time.monotonic() < deadline and self.process.poll() is None, "pulseaudio does not start"
            time.sleep(0.05)

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    @contextlib.contextmanager
    def recording(self, path):
        """The sink's monitor, as raw floats of two channels."""
        with open(path, "wb") as out:
            recorder = subprocess.Popen(["parec", "-d", "ci.monitor", "--format=float32le", f"--rate={RATE}", "--channels=2", "--raw",
                                         "--latency-msec=50"], env={**os.environ, **self.environment}, stdout=out,
                                        stderr=subprocess.DEVNULL)
            try:
                yield
            finally:
                recorder.terminate()
                recorder.wait(10)


def read_raw(path):
    data = np.fromfile(path, "<f4")
    return data[:len(data) // 2 * 2].reshape(-1, 2)


def share_found(wanted, recorded, length=RATE // 5, tolerance=0.0):
    """The share of the pieces of `wanted` that sound and are in `recorded`, sample for sample, in the same order."""
    at, found, asked = 0, 0, 0
    for begin in range(0, len(wanted) - length, length):
        piece = wanted[begin:begin + length]
        probe = int(np.argmax(np.abs(piece[:, 0])))
        if abs(piece[probe, 0]) < 1e-4:
            continue
        asked += 1
        for hit in np.flatnonzero(np.abs(recorded[at:, 0] - piece[probe, 0]) <= tolerance) + at:
            start = hit - probe
            there = recorded[start:start + length] if start >= 0 else recorded[:0]
            if there.shape == piece.shape and np.abs(there - piece).max() <= tolerance:
                at, found = start, found + 1
                break
    return found / asked if asked else 0.0, asked


@contextlib.contextmanager
def live_sound(ends):
    """A live session that sounds all the time."""
    replay = subprocess.Popen([BIN / "rustle", "replay", STORED_CAPTURE, "--clock", "live", "--loop", "0", "--control", ends["control"]],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        heard = [BIN / "rustle", "listen", "--control", ends["control"], "--seconds", "0.05"]
        wait_until(lambda: subprocess.run(heard, capture_output=True, timeout=20).returncode == 0, 20, "the replay is not heard")
        yield
    finally:
        replay.terminate()
        replay.wait(10)


@contextlib.contextmanager
def environment(values):
    before = dict(os.environ)
    os.environ.update(values)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


class Log:
    """The daemon's standard error, line by line with the time it said so."""

    def __init__(self, process):
        self.lines = []
        threading.Thread(target=self.read, args=(process.stderr,), daemon=True).start()

    def read(self, stream):
        with contextlib.suppress(ValueError):
            for line in stream:
                self.lines.append(line)

    def wait_for(self, words, seconds, count=1):
        deadline = time.monotonic() + seconds
        while sum(words in line for line in self.lines) < count:
            if time.monotonic() > deadline:
                raise AssertionError(f"rustled did not say '{words}':\n" + "".join(self.lines))
            time.sleep(0.02)
        return [line for line in self.lines if words in line][count - 1]

    @staticmethod
    def time_of(line):
        return datetime.datetime.strptime(re.search(r"\[([\d-]+ [\d:.]+)\]", line)[1], "%Y-%m-%d %H:%M:%S.%f").timestamp()


@unittest.skipIf(missing("pulseaudio", "pactl", "parec"), "PulseAudio is not installed")
class Pulse(RustleTest):
    def test_the_null_sink_gets_what_was_rendered(self):
        server = PulseServer(self.folder)
        server.start()
        self.addCleanup(server.kill)
        heard, recorded = self.folder / "heard.wav", self.folder / "recorded.raw"
        with environment(server.environment), daemon(self.folder, "--audio-api", "pulse", "--device-buffer-ms", 150) as ends:
            log = Log(ends["process"])
            log.wait_for("playing on", 10)
            with live_sound(ends), server.recording(recorded):
                time.sleep(0.5)
                rustle("listen", "--control", ends["control"], "-o", heard, "--seconds", 6)
                time.sleep(1)
        share, asked = share_found(read_wav(heard)[1].astype("<f4"), read_raw(recorded))
        self.assertGreaterEqual(asked, 10)
        self.assertGreaterEqual(share, 0.7, f"of {asked} pieces")

    def test_a_server_that_dies_is_survived_and_found_again(self):
        server = PulseServer(self.folder)
        server.start()
        heard, recorded = self.folder / "heard.wav", self.folder / "recorded.raw"
        with environment(server.environment), daemon(self.folder, "--audio-api", "pulse", "--device-buffer-ms", 150) as ends:
            log = Log(ends["process"])
            log.wait_for("playing on", 10)
            with live_sound(ends):
                listener = subprocess.Popen([BIN / "rustle", "listen", "--control", ends["control"], "-o", heard, "--seconds", "8"],
                                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
                time.sleep(2)
                server.kill()
                killed_at = time.time()
                gone = log.wait_for("is gone", 5)
                time.sleep(1)
                server.start()
                self.addCleanup(server.kill)
                log.wait_for("playing on", 10, count=2)
                with server.recording(recorded):
                    said, _ = listener.communicate(timeout=30)
        # Stalls of this machine's scheduler come on top of the 200 ms.
        self.assertLess(Log.time_of(gone) - killed_at, 0.3)
        self.assertEqual(listener.returncode, 0, said)
        self.assertIn("0 samples missing", said)
        self.assertGreaterEqual(len(read_wav(heard)[1]), 8 * RATE)
        share, asked = share_found(read_wav(heard)[1].astype("<f4"), read_raw(recorded))
        self.assertGreater(share * asked, 2)


@unittest.skipIf(missing("jackd", "jack_rec"), "jackd or jack_rec is not installed")
class Jack(RustleTest):
    def test_the_dummy_driver_gets_what_was_rendered(self):
        with environment({"JACK_DEFAULT_SERVER": f"rustle-{os.getpid()}", "JACK_NO_AUDIO_RESERVATION": "1"}):
            server = subprocess.Popen(["jackd", "-n", os.environ["JACK_DEFAULT_SERVER"], "--no-realtime", "-d", "dummy", "-r", str(RATE),
                                       "-p", "256"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            self.addCleanup(server.wait)
            self.addCleanup(server.terminate)  # killed ones stay in JACK's registry, which has room for eight
            heard, recorded = self.folder / "heard.wav", self.folder / "recorded.wav"
            with daemon(self.folder, "--audio-api", "jack", "--device-buffer-ms", 150) as ends:
                Log(ends["process"]).wait_for("playing on", 10)
                with live_sound(ends):
                    recorder = subprocess.Popen(["jack_rec", "-f", recorded, "-d", "8", "-b", "32", "rustled:outport 0", "rustled:outport 1"],
                                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                    time.sleep(0.5)
                    rustle("listen", "--control", ends["control"], "-o", heard, "--seconds", 6)
                    recorder.wait(30)
        rendered, played = read_wav(heard)[1], read_wav(recorded)[1]
        # jack_rec stores integers.
        share, asked = share_found(rendered, played, tolerance=2.0 ** -23)
        self.assertGreaterEqual(asked, 10)
        self.assertGreaterEqual(share, 0.5, f"of {asked} pieces")


class WithoutDevice(RustleTest):
    def test_a_device_that_is_not_there_is_named_once_and_hurts_nobody(self):
        nowhere = {"PULSE_SERVER": f"unix:{self.folder}/none", "JACK_DEFAULT_SERVER": "rustle-none"}
        with environment(nowhere), daemon(self.folder, "--device", "no such device") as ends:
            log = Log(ends["process"])
            line = log.wait_for("no such device", 10)
            self.assertIn("--list-devices", line)
            with live_sound(ends):
                rustle("listen", "--control", ends["control"], "--seconds", 2)
            self.assertEqual(sum("no such device" in said for said in log.lines), 1)

    def test_devices_are_listed_or_their_lack_is_named(self):
        nowhere = {**os.environ, "PULSE_SERVER": f"unix:{self.folder}/none", "JACK_DEFAULT_SERVER": "rustle-none"}
        done = subprocess.run([BIN / "rustled", "--list-devices", "--audio-api", "jack"], env=nowhere, capture_output=True, text=True, timeout=30)
        self.assertEqual(done.returncode, 1)
        self.assertIn("start a sound server", done.stderr)


if __name__ == "__main__":
    main()
