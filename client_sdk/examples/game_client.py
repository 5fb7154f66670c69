#!/usr/bin/env python3
"""A game engine in small: it moves sheets, takes their sounds dry with their places, and spatializes them itself.

usage: game_client.py [-o WAV] [--seconds S] [--control ENDPOINT]

The game loop runs at its own rate and never waits for sound. Beside it, another task takes emitters as they come: each is a
positional sound of the engine's, moved to where the daemon says, heard by a player who walks past. A real engine hands its blocks
to its own mixer; this one mixes to stereo, 1/distance and left to right, and writes a file.
"""
import argparse
import asyncio
import sys

import numpy as np

import rustle

FRAMES_PER_S = 60


class Player:
    """Walks past the sheets along x, looking along +y."""

    def place(self, t):
        return np.array([-1.5 + 0.75 * t, -1.0, 0.3])


class PositionalSound:
    """What a game engine has for every emitter: a place, and samples that wait to be mixed."""

    def __init__(self, emitter):
        self.move(emitter)

    def move(self, emitter):
        self.position, self.normal = np.array(emitter.position), np.array(emitter.normal)

    def gains(self, ears):
        """Left and right: a dipole, |cos θ| / R, panned by the direction with constant power."""
        toward = ears - self.position
        distance = max(0.1, float(np.linalg.norm(toward)))
        level = max(0.1, abs(float(toward @ self.normal)) / distance) / distance
        angle = np.arctan2(-toward[0], -toward[1])  # 0: straight ahead; positive: to the right
        pan = (np.clip(angle / (np.pi / 2), -1, 1) + 1) * np.pi / 4
        return level * np.array([np.cos(pan), np.sin(pan)])


class Mixer:
    """Stereo samples from the session's first on; sounds are added where they belong."""

    def __init__(self, rate_hz, player):
        self.rate_hz, self.player = rate_hz, player
        self.mix = np.zeros((0, 2), np.float32)  # grows ahead of what was mixed
        self.length = 0
        self.sounds, self.heard, self.most_at_once = {}, set(), 0

    def take(self, block):
        emitter = block.emitter
        sound = self.sounds.setdefault(emitter.emitter_id, PositionalSound(emitter))
        sound.move(emitter)
        self.heard.add(emitter.emitter_id)
        self.most_at_once = max(self.most_at_once, len(self.sounds))
        end = block.first_sample + len(block.samples)
        if end > len(self.mix):
            self.mix = np.concatenate([self.mix, np.zeros((end - len(self.mix) + self.rate_hz, 2), np.float32)])
        self.length = max(self.length, end)
        gains = sound.gains(self.player.place(block.time_s))
        self.mix[block.first_sample:end] += block.samples[:, :1] * gains.astype(np.float32)
        if emitter.last:
            del self.sounds[emitter.emitter_id]


async def game_loop(session, seconds):
    """Two sheets: one bends to and fro in the air, one slides on a table. Sends a frame of each, then waits for the next."""
    flat, triangles = rustle.sheets.rectangle(0.21, 0.297, 12, 17)
    session.scene(0.0, obstacles=[rustle.Obstacle(1, rustle.Plane())])
    session.add_topology(1, triangles, material_coordinates=flat)
    clock = asyncio.get_running_loop()
    start = clock.time()
    for frame in range(round(seconds * FRAMES_PER_S)):
        t = frame / FRAMES_PER_S
        await asyncio.sleep(max(0.0, start + t - clock.time()))
        waved = rustle.sheets.bent(flat, 8 * np.sin(2 * np.pi * 2 * t), 0.4) + np.float32([-0.6, 0, 0])
        slid = rustle.sheets.bent(flat, 3.0, 0.001) + np.float32([0.6 + 0.15 * np.sin(2 * np.pi * 0.7 * t), 0, 0])
        session.frame(1, 1, t, waved)  # LIVE clock: never waits
        session.frame(2, 1, t, slid)
    session.end()


async def run(arguments):
    sheets = [rustle.SheetOptions(1, name="waved"), rustle.SheetOptions(2, name="slid")]
    options = rustle.SessionOptions(name="game", clock=rustle.Clock.LIVE, sheets=sheets)
    with rustle.Connection.connect(arguments.control) as daemon, rustle.Session.attach(daemon, options) as session:
        mixer = Mixer(session.options.rate_hz, Player())
        async with session.listen_async(emitters=True) as emitters:
            game = asyncio.create_task(game_loop(session, arguments.seconds))
            async for block in emitters:
                mixer.take(block)
            await game
        figures = session.detach()
    rustle.Sound(mixer.mix[:mixer.length], mixer.rate_hz, 0).write_wav(arguments.output)
    print(f"{figures.frames_analysed} frames of two sheets, {len(mixer.heard)} emitters, {mixer.most_at_once} at once, "
          f"{emitters.missing_samples} samples missing")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="Example: game_client.py -o walk.wav --seconds 4")
    parser.add_argument("-o", "--output", default="game.wav", help="WAV file for what the player hears (%(default)s)")
    parser.add_argument("--seconds", type=float, default=4.0, help="how long (%(default)s)")
    parser.add_argument("--control", default=rustle.Endpoints().control, help="the daemon's control endpoint (%(default)s)")
    try:
        asyncio.run(run(parser.parse_args()))
    except rustle.RustleError as error:
        print(f"game_client.py: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
