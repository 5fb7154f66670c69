"""What the end-to-end tests share: the programs under test, sheets to make captures of, and sound files read back."""
import contextlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("RUSTLE_BUILD", SOURCE / "build/release"))
BIN = BUILD / "bin"
SHARED = SOURCE.parent / "shared"
STORED_CAPTURE = SOURCE / "tests/golden/capture/v1_small.mcap"


def rustle(*arguments, status=0, **options):
    """Runs `rustle`; fails unless it ends with `status`. Returns the finished process."""
    done = subprocess.run([BIN / "rustle", *map(str, arguments)], capture_output=True, text=True, timeout=300, **options)
    if done.returncode != status:
        raise AssertionError(f"rustle {' '.join(map(str, arguments))}: status {done.returncode}, wanted {status}\n{done.stdout}{done.stderr}")
    return done


def read_wav(path):
    """(rate, samples [n, channels] in ±1) of a 16, 24 bit or float WAV file."""
    data = pathlib.Path(path).read_bytes()
    at, form = 12, None
    while at + 8 <= len(data):
        name, size = data[at:at + 4], int.from_bytes(data[at + 4:at + 8], "little")
        body = data[at + 8:at + 8 + size]
        if name == b"fmt ":
            tag = int.from_bytes(body[0:2], "little")
            form = dict(tag=int.from_bytes(body[24:26], "little") if tag == 0xFFFE else tag, channels=int.from_bytes(body[2:4], "little"),
                        rate=int.from_bytes(body[4:8], "little"), bits=int.from_bytes(body[14:16], "little"))
        if name == b"data":
            if form["bits"] == 32 and form["tag"] == 1:
                flat = np.frombuffer(body[:len(body) // 4 * 4], "<i4") / 2147483648.0
            elif form["bits"] == 32:
                flat = np.frombuffer(body, "<f4").astype(float)
            elif form["bits"] == 16:
                flat = np.frombuffer(body, "<i2") / 32768.0
            else:
                raw = np.frombuffer(body, np.uint8).reshape(-1, 3).astype(np.int32)
                flat = ((raw[:, 0] | raw[:, 1] << 8 | raw[:, 2] << 16) << 8 >> 8) / 8388608.0
            return form["rate"], flat.reshape(-1, form["channels"])
        at += 8 + size + (size & 1)
    raise AssertionError(f"{path}: no samples")


def read_events(path):
    return [json.loads(line) for line in pathlib.Path(path).read_text().splitlines()]


def rms_dbfs(samples):
    samples = np.asarray(samples, float)
    return 10 * np.log10(np.mean(samples ** 2) + 1e-30) if samples.size else -300.0


# ---- sheets

def grid(width, height, nx, ny):
    """Material coordinates [V,2] and triangles [T,3] of a rectangle."""
    u, v = np.meshgrid(np.linspace(0, width, nx + 1), np.linspace(0, height, ny + 1))
    i = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    a, b, c, d = i, i + 1, i + nx + 2, i + nx + 1
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    return np.stack([u.ravel(), v.ravel()], 1).astype(np.float32), triangles


def bent(material, curvature):
    """The rectangle bent along x to this curvature in 1/m, z up, standing on its straight edges at z = 0."""
    s = material[:, 0] - material[:, 0].mean()
    k = curvature if abs(curvature) > 1e-9 else 1e-9
    x, z = np.sin(k * s) / k, (np.cos(k * s) - 1) / k
    return np.stack([x, material[:, 1] - material[:, 1].mean(), z - z.min()], 1)


def curvature_of(length, compression):
    """Of an arc this long whose chord is (1 - compression) of it."""
    low, high = 1e-6, np.pi
    for _ in range(80):
        x = (low + high) / 2
        low, high = (x, high) if np.sin(x) / x > 1 - compression else (low, x)
    return 2 * low / length


def save_npz(path, positions, triangles, times, **more):
    np.savez(path, positions=np.asarray(positions, np.float32), triangles=triangles, times=np.asarray(times, float), **more)
    return path


def table(half_size=2.0):
    """A square obstacle at z = 0, as npz arrays."""
    h = half_size
    return dict(obstacle0_vertices=np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]], np.float32),
                obstacle0_triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32))


class RustleTest(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self):
        holder = tempfile.TemporaryDirectory()
        self.addCleanup(holder.cleanup)
        self.folder = pathlib.Path(holder.name)

    def import_npz(self, path, *options):
        capture = self.folder / (pathlib.Path(path).stem + ".mcap")
        rustle("import", path, "-o", capture, *options)
        return capture

    def render(self, capture, name="out", *options, status=0):
        """(rate, samples, events) of a capture."""
        wav, events = self.folder / f"{name}.wav", self.folder / f"{name}.jsonl"
        rustle("render", capture, "-o", wav, "--events", events, *options, status=status)
        rate, samples = read_wav(wav)
        return rate, samples, read_events(events)


@contextlib.contextmanager
def daemon(folder, *options, log=None, program=BIN / "rustled"):
    """A running rustled on ipc endpoints below `folder`, without HTTP unless asked; yields its endpoints. `log`: a file for
    what it says."""
    ends = {name: f"ipc://{folder}/{name}" for name in ("control", "stream", "out")}
    arguments = [program, "--control", ends["control"], "--stream", ends["stream"], "--out", ends["out"], *map(str, options)]
    if "--http" not in options:
        arguments += ["--http", "off"]
    said = open(log, "w+") if log else subprocess.PIPE
    process = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=said, text=True)
    try:
        deadline = time.monotonic() + 10
        while not all(pathlib.Path(end[6:]).exists() for end in ends.values()):
            if process.poll() is not None or time.monotonic() > deadline:
                raise AssertionError("rustled did not start: " + (process.stderr.read() if process.poll() is not None and not log else f"see {log}"))
            time.sleep(0.02)
        ends["process"] = process
        yield ends
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            raise AssertionError("rustled did not end within 10 s of SIGTERM")
        finally:
            (said if log else process.stderr).close()


def wait_until(condition, seconds, complaint):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise AssertionError(complaint)
        time.sleep(0.05)


def main():
    unittest.main(module=sys.modules["__main__"], verbosity=1)
