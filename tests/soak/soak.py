#!/usr/bin/python3
"""A rustled at a steady load, watched.   usage: soak.py [--minutes N] [--load SHARE]     see run.sh"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "e2e"))
from support import BIN, daemon, rustle, wait_until

EVERY_S = 5
MOST_SLOPE = 1.0  # MiB an hour
SETTLING = 0.25   # of the time: rings, caches and the allocator's arenas fill


def status_of(process):
    """Resident MiB, descriptors and threads."""
    proc = pathlib.Path(f"/proc/{process.pid}")
    told = proc.joinpath("status").read_text()
    return (int(re.search(r"VmRSS:\s+(\d+)", told)[1]) / 1024, len(list(proc.joinpath("fd").iterdir())),
            int(re.search(r"Threads:\s+(\d+)", told)[1]))


def slope_per_hour(times_s, values):
    """The median of the slopes of all pairs (Theil-Sen): a single step does not make a trend."""
    times_s, values = np.array(times_s), np.array(values)
    a, b = np.triu_indices(len(values), 1)
    return float(np.median((values[b] - values[a]) / (times_s[b] - times_s[a]))) * 3600


def main():
    asked = argparse.ArgumentParser(description=__doc__.split(".")[0])
    asked.add_argument("--minutes", type=float, default=60)
    asked.add_argument("--load", type=float, default=0.6)
    asked = asked.parse_args()
    crowd = ("--fps", 60, "--triangles", 1333, "--json")
    cost = json.loads(rustle("load", "--sessions", 10, "--seconds", 10, "--daemon-cpus", 0, *crowd).stdout)["cpu_s_per_session_s"]
    sessions = max(1, round(asked.load / cost))
    print(f"{cost:.4f} s of a core per session and second; {sessions} sessions are {asked.load:.0%}", flush=True)
    with tempfile.TemporaryDirectory() as folder, daemon(folder, "--device", "none", log=(log := pathlib.Path(folder) / "log")) as ends:
        wait_until(lambda: "control ipc" in log.read_text(), 60, "rustled does not serve")  # packs are read
        os.sched_setaffinity(ends["process"].pid, {0})
        for task in pathlib.Path(f"/proc/{ends['process'].pid}/task").iterdir():
            os.sched_setaffinity(int(task.name), {0})
        before = status_of(ends["process"])
        load = subprocess.Popen([BIN / "rustle", "load", "--control", ends["control"], "--sessions", str(sessions), "--seconds",
                                 str(60 * asked.minutes), *map(str, crowd)], stdout=subprocess.PIPE, text=True)
        begun, said, times_s, resident = time.monotonic(), -1, [], []
        while load.poll() is None:
            time.sleep(EVERY_S)
            now_s, (mib, descriptors, threads) = time.monotonic() - begun, status_of(ends["process"])
            if SETTLING * 60 * asked.minutes < now_s < 60 * asked.minutes:
                times_s.append(now_s)
                resident.append(mib)
            if int(now_s / 60) > said:
                said = int(now_s / 60)
                print(f"{said:3} min: {mib:.1f} MiB, {descriptors} descriptors, {threads} threads", flush=True)
        if load.returncode != 0:
            print(f"the load ended after {(time.monotonic() - begun) / 60:.1f} min; what rustled said last:\n{log.read_text()[-4000:]}")
            return 1
        figures = json.load(load.stdout)
        deadline = time.monotonic() + 60
        while (after := status_of(ends["process"]))[1] > before[1] and time.monotonic() < deadline:
            time.sleep(1)
    slope = slope_per_hour(times_s, resident)
    print(f"{slope:+.2f} MiB an hour; {figures['pcm_gaps']} gaps, {figures['deadline_misses']} blocks late by own time, "
          f"{sum(figures['dropped'].values())} frames dropped; {after[1] - before[1]} descriptors and {after[2] - before[2]} threads more than before")
    return 0 if slope < MOST_SLOPE and figures["pcm_gaps"] == 0 and after[1] <= before[1] and after[2] <= before[2] else 1


if __name__ == "__main__":
    sys.exit(main())
