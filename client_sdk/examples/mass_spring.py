#!/usr/bin/env python3
"""A sheet of paper as masses and springs in NumPy, attached to a running daemon.

usage: mass_spring.py [-o WAV] [--seconds S] [--live] [--control ENDPOINT]

The sheet hangs over a table from two hands that shake it, then let it down onto the table and pull it along. With --live it goes
at the pace of a clock and is heard by `rustle listen`, or on the daemon's sound card; else it goes as fast as it can and the
sound is written to a file.
"""
import argparse
import sys
import time

import numpy as np

import rustle

WIDTH_M, HEIGHT_M, COLUMNS, ROWS = 0.21, 0.297, 12, 17
GRAMMAGE_KG_PER_M2 = 0.08
FRAMES_PER_S, SUBSTEPS = 60, 40
GRAVITY_M_PER_S2 = np.array([0.0, 0.0, -9.81])
STRETCH_N_PER_M, BEND_N_PER_M = 25.0, 2.5
SPRING_DAMPING, AIR_DRAG_PER_S, TABLE_FRICTION_PER_S = 0.002, 1.5, 30.0


class Sheet:
    """V vertices in a grid, springs to the neighbours (stretch, shear) and to the next but one (bending)."""

    def __init__(self):
        self.material, self.triangles = rustle.sheets.rectangle(WIDTH_M, HEIGHT_M, COLUMNS, ROWS)
        x, z = self.material.astype(float).T
        wrinkles = 1e-3 * np.random.default_rng(1).standard_normal(len(x))  # paper is never flat
        self.positions = np.stack([x - WIDTH_M / 2, wrinkles, z + 0.1], axis=1)
        self.velocities = np.zeros_like(self.positions)
        self.mass_kg = GRAMMAGE_KG_PER_M2 * WIDTH_M * HEIGHT_M / len(x)
        index = np.arange(len(x)).reshape(ROWS + 1, COLUMNS + 1)
        pairs = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:]),
                 (index[:-1, :-1], index[1:, 1:]), (index[:-1, 1:], index[1:, :-1]),
                 (index[:, :-2], index[:, 2:]), (index[:-2], index[2:])]
        self.a, self.b = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
        self.ends = np.concatenate([self.a, self.b])
        bending = sum(pair[0].size for pair in pairs[4:])
        self.stiffness = np.full(len(self.a), STRETCH_N_PER_M)
        self.stiffness[-bending:] = BEND_N_PER_M
        self.rest_m = np.linalg.norm(self.material[self.a] - self.material[self.b], axis=1)
        self.held = np.zeros(len(x), bool)
        self.held[index[-1, [0, 1, -2, -1]]] = True
        self.grip = self.positions[self.held].copy()

    def forces(self):
        along = self.positions[self.b] - self.positions[self.a]
        length = np.sqrt(np.einsum("ij,ij->i", along, along))
        along /= length[:, None]
        closing = np.einsum("ij,ij->i", self.velocities[self.b] - self.velocities[self.a], along)
        pull = (self.stiffness * (length - self.rest_m) + SPRING_DAMPING * closing)[:, None] * along
        pulls = np.concatenate([pull, -pull])
        return np.stack([np.bincount(self.ends, pulls[:, k], len(self.positions)) for k in range(3)], axis=1)

    def step(self, dt_s, hands_m):
        """One substep, the hands moved by `hands_m` [3] from where they began."""
        acceleration = self.forces() / self.mass_kg + GRAVITY_M_PER_S2 - AIR_DRAG_PER_S * self.velocities
        self.velocities += dt_s * acceleration
        under = self.positions[:, 2] < 0.001
        self.velocities[under, 2] = np.maximum(self.velocities[under, 2], 0)
        self.velocities[under, :2] *= max(0.0, 1 - TABLE_FRICTION_PER_S * dt_s)
        target = self.grip + hands_m
        self.velocities[self.held] = (target - self.positions[self.held]) / dt_s
        self.positions += dt_s * self.velocities


def hands(t):
    """Where the hands are at t seconds, from where they began, in metres."""
    shake = 0.05 * np.sin(2 * np.pi * 4.5 * t) * (0.3 < t < 2.2)
    down = -0.36 * np.clip((t - 2.4) / 0.6, 0, 1)
    pulled = 0.25 * np.clip((t - 2.4) / 1.2, 0, 1)
    return np.array([0.0, shake + pulled, down])


def simulate(session, seconds, live):
    """Sends the table, the topology and every frame."""
    sheet = Sheet()
    session.scene(0.0, obstacles=[rustle.Obstacle(1, rustle.Plane(), reflecting=True)])
    session.add_topology(1, sheet.triangles, material_coordinates=sheet.material)
    start = time.monotonic()
    for frame in range(round(seconds * FRAMES_PER_S)):
        t = frame / FRAMES_PER_S
        if live:
            time.sleep(max(0.0, start + t - time.monotonic()))
        session.frame(1, 1, t, sheet.positions.astype(np.float32), anchored=sheet.held)
        for substep in range(SUBSTEPS):
            sheet.step(1 / FRAMES_PER_S / SUBSTEPS, hands(t + substep / SUBSTEPS / FRAMES_PER_S))
    session.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], epilog="Example: mass_spring.py -o sheet.wav --seconds 4")
    parser.add_argument("-o", "--output", default="mass_spring.wav", help="WAV file for what is heard (%(default)s)")
    parser.add_argument("--seconds", type=float, default=4.0, help="how long (%(default)s)")
    parser.add_argument("--live", action="store_true", help="at the pace of a clock, without a file")
    parser.add_argument("--control", default=rustle.Endpoints().control, help="the daemon's control endpoint (%(default)s)")
    arguments = parser.parse_args()
    clock = rustle.Clock.LIVE if arguments.live else rustle.Clock.SIMULATION
    options = rustle.SessionOptions(name="mass-spring", clock=clock, sheets=[rustle.SheetOptions(1)])
    try:
        with rustle.Connection.connect(arguments.control) as daemon, rustle.Session.attach(daemon, options) as session:
            if arguments.live:
                simulate(session, arguments.seconds, live=True)
            else:
                with session.listen() as reader:
                    simulate(session, arguments.seconds, live=False)
                    sound = reader.read_all()
                sound.write_wav(arguments.output)
            figures = session.detach()
    except rustle.RustleError as error:
        print(f"mass_spring.py: {error}", file=sys.stderr)
        return 1
    print(f"{figures.frames_analysed} frames, {figures.crumpling_events} crumpling events, {figures.friction_episodes} contacts that slid")
    return 0


if __name__ == "__main__":
    sys.exit(main())
