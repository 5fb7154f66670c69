"""A sheet of paper, bent to and fro over a table, through a running daemon.

usage: python3 -m rustle.demo [-o WAV] [--seconds S] [--live] [--control ENDPOINT]

Writes what is heard; with --live it goes at the pace of a clock, for `rustle listen` beside it.
"""
from __future__ import annotations

import argparse
import sys
import time

import numpy as np

import rustle


def main() -> int:
    parser = argparse.ArgumentParser(prog="python3 -m rustle.demo",
                                     description="Bend a sheet of paper through a running rustled.",
                                     epilog="Example: python3 -m rustle.demo -o bend.wav --seconds 4")
    parser.add_argument("-o", "--output", default="bend.wav", help="WAV file for what is heard (bend.wav)")
    parser.add_argument("--seconds", type=float, default=4.0, help="how long it bends (4)")
    parser.add_argument("--live", action="store_true", help="at the pace of a clock")
    parser.add_argument("--control", default=rustle.Endpoints().control, help="the daemon's control endpoint (%(default)s)")
    arguments = parser.parse_args()
    flat, triangles = rustle.sheets.rectangle(0.21, 0.297, 16, 22)
    clock = rustle.Clock.LIVE if arguments.live else rustle.Clock.SIMULATION
    try:
        with rustle.Connection.connect(arguments.control) as daemon:
            options = rustle.SessionOptions(name="bend", clock=clock, sheets=[rustle.SheetOptions(1)])
            with rustle.Session.attach(daemon, options) as session, session.listen() as reader:
                session.scene(0, obstacles=[rustle.Obstacle(1, rustle.Plane(), reflecting=True)])
                session.add_topology(1, triangles, material_coordinates=flat)
                start = time.monotonic()
                for t in np.arange(0, arguments.seconds, 1 / 60):
                    if arguments.live:
                        time.sleep(max(0.0, start + t - time.monotonic()))
                    session.frame(1, 1, t, rustle.sheets.bent(flat, 9 * np.sin(10 * t), height_m=0.1))
                session.end()
                sound = reader.read_all()
    except rustle.RustleError as error:
        print(f"rustle.demo: {error}", file=sys.stderr)
        return 1
    sound.write_wav(arguments.output)
    print(f"{arguments.output}: {len(sound.samples) / sound.rate_hz:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
