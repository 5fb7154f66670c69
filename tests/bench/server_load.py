#!/usr/bin/python3
"""What `rustle load` finds of this machine, against the goals: cost per session, a hundred on one core, a surge, a heavy one.

usage: server_load.py PROGRAM [--json] [--check] [--quick]
PROGRAM: the built `rustle`; --check: a missed goal makes the exit status 1; --quick: short runs, for a first look
"""
import json
import platform
import statistics
import subprocess
import sys

SHEETS = ("--fps", "60", "--triangles", "1333")


class Bench:
    def __init__(self, program, as_json, quick):
        self.program, self.as_json, self.quick, self.missed = program, as_json, quick, 0

    def load(self, *arguments):
        run = subprocess.run([self.program, "load", "--json", *SHEETS, *map(str, arguments)], capture_output=True, text=True)
        if not run.stdout:
            sys.exit(f"rustle load {' '.join(map(str, arguments))}: {run.stderr.strip()}")
        return json.loads(run.stdout)

    def row(self, name, figures):
        if self.as_json:
            print(json.dumps({"name": f"server/{name}", **figures}), flush=True)
        else:
            told = {key: value for key, value in figures.items() if not isinstance(value, (dict, list))}
            print(f"{name}: " + ", ".join(f"{key} {value:g}" if isinstance(value, float) else f"{key} {value}"
                                          for key, value in told.items()), flush=True)

    def goal(self, what, value, bound):
        met = value is not None and value <= bound
        self.missed += not met
        shown = "      none" if value is None else f"{value:10.4f}"
        print(f"{'met' if met else 'MISSED':6} {what:56}{shown}   goal {bound:g}", file=sys.stderr if self.as_json else sys.stdout,
              flush=True)

    def cost(self):
        figures = self.load("--sessions", 10, "--seconds", 5 if self.quick else 30)
        self.row("sessions", figures)
        self.goal("cpu_s_per_session_s, all crumpling or sliding", figures["cpu_s_per_session_s"], 1 / 150)
        self.goal("p99 beyond the playout delay, ms", figures["latency_ms"]["p99"] - figures["playout_delay_ms"], 20)

    def hundred(self):
        figures = self.load("--sessions", 100, "--seconds", 5 if self.quick else 30, "--daemon-cpus", 0)
        self.row("hundred_on_one_core", figures)
        self.goal("a hundred on one core: blocks late by own time", figures["deadline_misses"], 0)
        self.goal("a hundred on one core: frames dropped", sum(figures["dropped"].values()), 0)

    def surge(self, cost):
        """A core loaded to two thirds, then to four thirds for a minute."""
        sessions = max(2, int(0.66 / cost))
        before, during, after = (2, 8, 12) if self.quick else (5, 60, 15)
        figures = self.load("--sessions", sessions, "--daemon-cpus", 0, "--seconds", before + during + after,
                            "--surge", f"2:{before}:{before + during}")
        self.row("surge", figures)
        self.goal("surge: sums inexact", 0 if figures["sums_exact"] else 1, 0)
        self.goal("surge: longest silence of any session, s", figures["longest_silence_s"], 0.5)
        self.goal("surge: full quality again after, s", figures["full_quality_after_s"], 10)

    def fairness(self):
        """Fifteen sessions with and without one that sends ten times the frames of a hundred thousand triangles."""
        pairs = []
        for _ in range(2 if self.quick else 5):
            alone = self.load("--sessions", 15, "--seconds", 4 if self.quick else 10)
            beside = self.load("--sessions", 15, "--seconds", 4 if self.quick else 10, "--heavy", 1, "--heavy-fps", 600,
                               "--heavy-triangles", 100000)
            pairs.append((alone, beside))
        growths = [b["latency_ms"]["p99"] - a["latency_ms"]["p99"] for a, b in pairs]
        bounds = [max(0.1 * a["latency_ms"]["p99"], 2) for a, _ in pairs]
        lost = statistics.median(sum(b["dropped"].values()) + b["pcm_gaps"] - sum(a["dropped"].values()) - a["pcm_gaps"]
                                 for a, b in pairs)
        self.row("fairness", {"p99_growth_ms": statistics.median(growths), "bound_ms": statistics.median(bounds), "lost": lost,
                              "p99_ms": [[a["latency_ms"]["p99"], b["latency_ms"]["p99"]] for a, b in pairs],
                              "heavy_dropped": [b["heavy"]["dropped"] for _, b in pairs]})
        self.goal("beside a heavy one: growth of p99, ms", statistics.median(growths), statistics.median(bounds))
        self.goal("beside a heavy one: frames and sound lost", lost, 0)


def main():
    arguments = sys.argv[1:]
    if not arguments or arguments[0].startswith("-"):
        sys.exit(__doc__.strip())
    flags = set(arguments[1:])
    bench = Bench(arguments[0], "--json" in flags, "--quick" in flags)
    cpu = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown")
    bench.row("machine", {"processor": cpu, "system": platform.platform()})
    one = bench.load("--sessions", 10, "--seconds", 5, "--daemon-cpus", 0)["cpu_s_per_session_s"]
    bench.cost()
    bench.hundred()
    bench.surge(one)
    bench.fairness()
    sys.exit(1 if bench.missed and "--check" in flags else 0)


if __name__ == "__main__":
    main()
