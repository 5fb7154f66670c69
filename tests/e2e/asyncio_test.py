#!/usr/bin/python3
"""The Python SDK's readers for asyncio, and the SDK as a wheel."""
import asyncio
import gc
import logging
import os
import shutil
import subprocess
import sys
import time

import numpy as np

from support import BUILD, RustleTest, bent, curvature_of, daemon, grid, main, rms_dbfs

sys.path.insert(0, str(BUILD / "python"))
import rustle

logging.getLogger("rustle").setLevel(logging.CRITICAL)

OPTIONS = rustle.SessionOptions(name="sheet", clock=rustle.Clock.SIMULATION, sheets=[rustle.SheetOptions(1)])
MATERIAL, TRIANGLES = grid(0.2, 0.1, 16, 8)
CURVATURE = curvature_of(0.2, 0.1)


def send(session, times, end=True):
    """A sheet that is bent to and fro, four times a second."""
    for t in times:
        session.frame(1, 1, t, bent(MATERIAL, CURVATURE * np.sin(8 * np.pi * t)).astype(np.float32))
    if end:
        session.end()


class Asyncio(RustleTest):
    def setUp(self):
        super().setUp()
        self.ends = self.enterContext(daemon(self.folder))
        self.connection = self.enterContext(rustle.Connection.connect(self.ends["control"]))
        self.session = self.enterContext(rustle.Session.attach(self.connection, OPTIONS, reconnect=False))
        self.session.add_topology(1, TRIANGLES, material_coordinates=MATERIAL)

    async def ticks(self, counted):
        while True:
            counted.append(time.monotonic())
            await asyncio.sleep(0.005)

    def test_the_same_blocks_as_the_blocking_reader(self):
        async def hear():
            async with self.session.listen_async() as sound, self.session.listen_async() as whole:
                sending = asyncio.create_task(asyncio.to_thread(send, self.session, np.arange(60) / 60))
                blocks = [block async for block in sound]
                await sending
                return blocks, await whole.read_all()

        with self.session.listen() as reader:
            blocks, whole = asyncio.run(hear())
            expected = reader.read_all()
        self.assertGreater(rms_dbfs(expected.samples), -60)
        np.testing.assert_array_equal(np.concatenate([block.samples for block in blocks]), expected.samples)
        np.testing.assert_array_equal(whole.samples, expected.samples)
        self.assertEqual((whole.rate_hz, whole.first_sample, whole.gaps), (expected.rate_hz, 0, ()))
        self.assertEqual([block.first_sample for block in blocks[:3]], [0, 512, 1024])

    def test_others_run_while_it_waits_and_while_much_has_come(self):
        async def hear():
            idle, busy = [], []
            async with self.session.listen_async() as sound:
                ticking = asyncio.create_task(self.ticks(idle))
                self.assertIsNone(await sound.next(0.5))
                ticking.cancel()
                await asyncio.to_thread(send, self.session, np.arange(60) / 60)
                await asyncio.to_thread(self.session.drain)
                await asyncio.sleep(0.5)  # all of it waits here
                ticking = asyncio.create_task(self.ticks(busy))
                blocks = [block async for block in sound if time.sleep(0.001) is None]
                ticking.cancel()
                return len(idle), len(busy), len(blocks)

        idle, busy, blocks = asyncio.run(hear())
        self.assertGreater(idle, 5)
        self.assertGreater(blocks, 50)
        self.assertGreater(busy, 5)

    def test_a_cancelled_read_loses_nothing(self):
        async def hear():
            async with self.session.listen_async() as sound:
                for _ in range(3):
                    with self.assertRaises(TimeoutError):
                        await asyncio.wait_for(sound.next(), 0.05)
                sending = asyncio.create_task(asyncio.to_thread(send, self.session, np.arange(30) / 60))
                heard, deadline = [], time.monotonic() + 60
                while not heard or not heard[-1].end:
                    self.assertLess(time.monotonic(), deadline)
                    try:
                        async with asyncio.timeout(0.002):
                            heard.append(await sound.next())
                    except TimeoutError:
                        pass
                await sending
                return heard

        with self.session.listen() as reader:
            heard = asyncio.run(hear())
            expected = reader.read_all().samples
        np.testing.assert_array_equal(np.concatenate([block.samples for block in heard[:-1]]), expected)
        self.assertEqual((heard[-1].first_sample, sum(block.missing_samples for block in heard)), (len(expected), 0))

    def test_stems_and_observations(self):
        async def hear():
            async with self.session.observe_async() as observations, self.session.listen_async(stem=(1, "crumpling")) as stem:
                sending = asyncio.create_task(asyncio.to_thread(send, self.session, np.arange(60) / 60))
                first = await observations.next(30)
                async for observation in observations:
                    break
                sound = await stem.read_all()
                await sending
                return first, observation, sound

        first, second, sound = asyncio.run(hear())
        self.assertEqual((first.sheet_id, first.time_s < second.time_s), (1, True))
        self.assertTrue(first.crumpling)
        self.assertGreater(rms_dbfs(sound.samples), -60)

    def test_the_first_read_subscribes(self):
        async def hear():
            sending = asyncio.create_task(self.wait_and_send())
            count = 0
            async for block in self.session.listen_async():
                count += len(block.samples)
            await sending
            return count

        self.assertGreater(asyncio.run(hear()), 48000 // 4)

    async def wait_and_send(self):
        await asyncio.sleep(1)
        await asyncio.to_thread(send, self.session, np.arange(30) / 60)

    def test_closed_cancelled_and_forgotten_readers_leave_nothing_open(self):
        sockets = self.connection.link.sockets._open
        before = len(sockets)

        async def hear():
            reader = self.session.listen_async()
            self.assertTrue(reader.is_heard())
            async with reader:
                waiting = asyncio.create_task(reader.next())
                await asyncio.sleep(0.05)
                reader.close()
                with self.assertRaises(rustle.Closed):
                    await waiting
            with self.assertRaises(rustle.Closed):
                await reader.open()
            for patience in (0, 0.001, 0.003):
                opening = asyncio.create_task(self.session.listen_async().open())
                await asyncio.sleep(patience)
                opening.cancel()
            await self.session.listen_async().open()

        asyncio.run(hear())
        gc.collect()
        self.assertEqual(len(sockets), before)
        for wrong in ({"stem": (1, "drumming")}, {"format": "mp3"}):
            with self.assertRaises(rustle.InvalidArgument):
                self.session.listen_async(**wrong)

    def test_a_daemon_that_goes_is_unreachable(self):
        async def hear():
            async with self.session.listen_async() as sound:
                self.ends["process"].kill()
                await sound.next(30)

        with self.assertRaises(rustle.Unreachable):
            asyncio.run(hear())


class Wheel(RustleTest):
    def test_a_wheel_is_built_and_runs(self):
        source, installed = self.folder / "source", self.folder / "installed"
        shutil.copytree(BUILD / "python", source, ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
        quiet = ["--quiet", "--disable-pip-version-check", "--no-cache-dir", "--no-deps", "--no-index"]
        environment = {**os.environ, "PIP_ROOT_USER_ACTION": "ignore"}

        def pip(*arguments):
            done = subprocess.run([sys.executable, "-m", "pip", *map(str, arguments)], env=environment, capture_output=True, text=True, timeout=300)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

        pip("wheel", *quiet, "--no-build-isolation", source, "--wheel-dir", self.folder)
        wheel, = self.folder.glob("*.whl")
        self.assertEqual(wheel.name, f"rustle-{rustle.__version__}-py3-none-any.whl")
        pip("install", *quiet, "--target", installed, wheel)
        names = {str(path.relative_to(installed)) for path in installed.rglob("*")}
        for name in ("rustle/py.typed", "rustle/v1/session_pb2.pyi", "rustle/async_readers.py"):
            self.assertIn(name, names)
        command = [sys.executable, "-m", "rustle.demo", "-o", str(self.folder / "bend.wav"), "--seconds", "0.5"]
        with daemon(self.folder) as ends:
            subprocess.run([*command, "--control", ends["control"]], check=True, cwd=installed, env={**os.environ, "PYTHONPATH": str(installed)},
                           capture_output=True, timeout=60)
        self.assertGreater((self.folder / "bend.wav").stat().st_size, 48000)


if __name__ == "__main__":
    main()
