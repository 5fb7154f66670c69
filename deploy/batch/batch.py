#!/usr/bin/python3
"""Renders a folder of captures, one command for each: through GNU parallel, processes of its own, or a Slurm array."""
import argparse
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import sys
import time

import engines
import slurm
from plan import DONE, FAILED, INCOMPLETE, Locks, Mistake, Plan, make_plan, written_whole
from render import check_version, render_these
from report import counted, duration, level, make_report, summary_lines

DESCRIPTION = "Render a folder of captures, one command for each capture. What is done is not done again."
EXAMPLE = """Example, on one machine:
  batch.py plan takes/ out/ -- --material tracing-paper
  batch.py run out/
On a cluster with Slurm:
  batch.py plan takes/ out/
  batch.py slurm out/ --wait -- --partition=short
Start an interrupted run again, and it goes on. What is rendered stays until the capture changes or a new plan has other
options, or was made by another version of rustle.
Exit status: 0 all is rendered, 1 something failed, is incomplete or not rendered yet, 2 wrong usage. `batch.py COMMAND --help` tells more."""
SHOW_EVERY_S = 30  # where there is no terminal


class Progress:
    """How far a run is and when it will be done: a line that overwrites itself on a terminal, else one now and then. What is left is
    judged by the captures' sizes."""

    def __init__(self, sizes):
        self.sizes, self.count, self.done, self.failed = sizes, len(sizes), 0, []
        self.all_bytes, self.done_bytes = max(1, sum(sizes.values())), 0
        self.began = self.shown = time.monotonic()
        self.terminal = sys.stderr.isatty()

    def say(self, text):
        print(("\r\x1b[K" if self.terminal else "") + text, file=sys.stderr, flush=True)

    def add(self, told):
        self.done += 1
        self.done_bytes += self.sizes.get(told["number"], 0)
        if told["state"] != DONE:
            self.failed.append(told["number"])
            self.say(f"{told['capture']}: {told['state']}: {told['reason']}")
        now = time.monotonic()
        if not self.terminal and now - self.shown < SHOW_EVERY_S:
            return
        self.shown = now
        left_s = (now - self.began) * (self.all_bytes / max(1, self.done_bytes) - 1)
        wrong = f", {len(self.failed)} not as it should be" if self.failed else ""
        line = f"rendered {self.done} of {self.count}{wrong}; {duration(left_s)} left"
        if self.terminal:
            width = shutil.get_terminal_size().columns
            print("\r\x1b[K" + line[:width - 1], end="", file=sys.stderr, flush=True)
        else:
            print(line, file=sys.stderr, flush=True)

    def end(self):
        if self.terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def find_program(named):
    """Absolute path of `rustle`: as named, from $PATH, or from this project's build."""
    built = pathlib.Path(__file__).resolve().parents[2] / "build/release/bin/rustle"
    found = shutil.which(named or "rustle") or (str(built) if not named and built.is_file() else None)
    if not found:
        raise Mistake(f"{named} is no program that can be run" if named else
                      "rustle is neither on $PATH nor built here; build it with deploy/quickstart.sh, or name it with --program")
    return os.path.abspath(found)


def numbers_of(words, count):
    """"3", "5-8" as numbers of captures."""
    numbers = []
    for word in words:
        match = re.fullmatch(r"(\d+)(?:-(\d+))?", word)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not 1 <= first <= last <= count:
            raise Mistake(f"{word}: captures are numbered from 1 to {count}; say 3, or 5-8")
        numbers += range(first, last + 1)
    return numbers


def plan_command(arguments):
    plan = make_plan(arguments.folder, arguments.out, find_program(arguments.program), arguments.passed_on, arguments.pages, arguments.anew)
    pending = len(plan.pending())
    print(f"{plan.out}: {counted(len(plan.captures), 'capture')}, {pending} to render; next: {shlex.join([sys.argv[0], 'run', arguments.out])}")
    return 0


def list_command(arguments):
    plan = Plan.load(arguments.out)
    for number in plan.pending(arguments.retry) if arguments.pending else range(1, len(plan.captures) + 1):
        print(number if arguments.pending else f"{number}\t{plan.result(number)['state']}\t{plan.captures[number - 1]}")
    return 0


def one_command(arguments):
    plan = Plan.load(arguments.out)
    numbers = numbers_of(arguments.number, len(plan.captures))
    check_version(plan)
    status = 0

    def tell(number, result, rendered):
        nonlocal status
        status = max(status, result["state"] != DONE)
        if arguments.json:
            print(json.dumps({"number": number, "capture": plan.captures[number - 1], "state": result["state"], "reason": result["reason"],
                              "rendered": rendered}), flush=True)
            return
        text = f"{number} of {len(plan.captures)}, {plan.captures[number - 1]}: {'' if rendered else 'nothing to do, '}{result['state']}"
        if "render" in result:
            events = result["render"]["events"]
            text += (f"; {result['render']['seconds']:.2f} s of sound, {', '.join(f'{count} {kind}' for kind, count in events.items())}, "
                     f"peak {level(result['render']['peak_dbfs'])}, took {duration(result['elapsed_s'])}")
        print(text + (f": {result['reason']}" if result["reason"] else ""), flush=True)

    with Locks(plan.out) as locks:
        render_these(plan, numbers, locks, arguments.retry, not arguments.no_wait, tell)
    return status


def run_command(arguments):
    plan = Plan.load(arguments.out)
    parallel = engines.gnu_parallel() if arguments.engine != "pool" else None
    if arguments.engine == "parallel" and not parallel:
        raise Mistake("GNU parallel is not here; apt install parallel, or leave --engine out")
    pending = plan.pending(arguments.retry)
    rendered, said = 0, []
    if pending:
        check_version(plan)
        progress = Progress({number: os.path.getsize(plan.capture(number)) for number in pending if os.path.exists(plan.capture(number))})
        said = progress.failed
        more = ["--json", *(["--retry"] if arguments.retry else [])]
        try:
            # First what no other run has in hand, then what is left of that.
            for last in (False, True):
                command = engines.command_of_one(plan, *more, *([] if last else ["--no-wait"]))
                told_of = set()
                for line in (engines.through_parallel(parallel, command, pending, arguments.jobs) if parallel else
                             engines.through_pool(command, pending, arguments.jobs)):
                    told = json.loads(line)
                    told_of.add(told["number"])
                    rendered += told["rendered"]
                    progress.add(told)
                pending = [number for number in pending if number not in told_of]
                if not pending:
                    break
        finally:
            progress.end()
    if not rendered:
        print("nothing to do")
    return tell_report(plan, said)


def slurm_command(arguments):
    plan = Plan.load(arguments.out)
    pending = plan.pending(arguments.retry)
    if not pending:
        print("nothing to do")
        return report_command(arguments)
    check_version(plan)
    text, tasks, per_task = slurm.script_of(plan, pending, (arguments.array_size or slurm.array_size()) - 1, arguments.per_task, arguments.at_once,
                                            arguments.retry)
    script = plan.out / "slurm/batch.sh"
    with written_whole(script) as file:
        file.write(text)
    print(f"{script}: {counted(len(pending), 'capture')} in {counted(tasks, 'task')} of up to {per_task}")
    if not (arguments.submit or arguments.wait):
        print(f"next: {shlex.join(['sbatch', *arguments.passed_on, str(script)])}, or the same with --submit")
        return 0
    print(f"Slurm's job {slurm.submit(script, arguments.wait, arguments.passed_on)}", flush=True)
    if arguments.wait:
        return report_command(arguments)
    print(f"what the tasks say is in {script.parent}; when they are done: {shlex.join([sys.argv[0], 'report', arguments.out])}")
    return 0


def report_command(arguments):
    return tell_report(Plan.load(arguments.out))


def tell_report(plan, said=()):
    """Writes the report and prints its essence: failures but those of which it was `said` already, and totals."""
    report = make_report(plan)
    bad = [row for row in report["failures"] if row["state"] in (FAILED, INCOMPLETE)]
    for row in bad:
        if row["number"] not in said:
            print(f"{row['capture']}: {row['state']}: {row['reason']}")
    if bad:
        print("mend these captures, or try them again as they are with --retry")
    for line in summary_lines(plan, report["totals"]):
        print(line)
    return 1 if report["failures"] else 0


def parser():
    def command(name, run, text, epilog):
        added = commands.add_parser(name, help=text, description=text + ".", epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter)
        added.set_defaults(run=run, passes_on=False)
        return added

    def retry(added):
        added.add_argument("--retry", action="store_true", help="also what failed or was incomplete, though the capture has not changed")

    out = {"metavar": "OUT", "help": "the batch's folder, as `plan` made it"}
    top = argparse.ArgumentParser(prog="batch.py", description=DESCRIPTION, epilog=EXAMPLE, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = top.add_subparsers(metavar="COMMAND", required=True)

    added = command("plan", plan_command, "List the captures and how they are to be rendered; do it again when there are more, or other options",
                    "Example: batch.py plan takes/ out/ -- --material tracing-paper --rate 44100\nAfter -- come options of `rustle render`.")
    added.add_argument("folder", metavar="FOLDER", help="captures (*.mcap) are taken from here and the folders below")
    added.add_argument("out", metavar="OUT", help="folder to write to; made when missing")
    added.add_argument("--program", help="the `rustle` to use; without it that on $PATH, or the one built here")
    added.add_argument("--pages", action="store_true", help="write an HTML report of each capture too")
    added.add_argument("--anew", action="store_true", help="render all again, as after a sound pack was changed")
    added.set_defaults(passes_on=True)

    added = command("run", run_command, "Render on this machine what is not rendered yet, then report", "Example: batch.py run out/ --jobs 4")
    added.add_argument("out", **out)
    added.add_argument("-j", "--jobs", type=positive, default=len(os.sched_getaffinity(0)), help="captures at a time; as many as processors: %(default)s")
    added.add_argument("--engine", choices=("auto", "parallel", "pool"), default="auto", help="GNU parallel, a pool of processes, or what is there (auto)")
    retry(added)

    added = command("slurm", slurm_command, "Write an array script for Slurm, and submit it",
                    "Example: batch.py slurm out/ --wait -- --partition=short --time=30\nAfter -- come options of sbatch.")
    added.add_argument("out", **out)
    added.add_argument("--submit", action="store_true", help="give it to sbatch; without it, only the script is written")
    added.add_argument("--wait", action="store_true", help="submit, wait for the end, and report")
    added.add_argument("--per-task", type=positive, help="captures that one task renders; without it as few as Slurm's MaxArraySize lets")
    added.add_argument("--at-once", type=positive, help="tasks at a time; without it as many as Slurm lets")
    added.add_argument("--array-size", type=at_least_2, help=f"Slurm's MaxArraySize; without it as `scontrol show config` has it, else {slurm.ARRAY_SIZE}")
    retry(added)
    added.set_defaults(passes_on=True)

    added = command("report", report_command, "Merge what there is into OUT/report.json and OUT/report.html", "Example: batch.py report out/")
    added.add_argument("out", **out)

    added = command("one", one_command, "Render single captures: what the others run",
                    "Example: seq 400 | parallel batch.py one out/\nCaptures that are rendered already are left alone.")
    added.add_argument("out", **out)
    added.add_argument("number", metavar="N", nargs="+", help="a capture's number in the plan, or A-B")
    added.add_argument("--no-wait", action="store_true", help="leave out what another run has in hand")
    added.add_argument("--json", action="store_true", help="tell the outcome as JSON, a line for each capture")
    retry(added)

    added = command("list", list_command, "Print every capture's number, state and path",
                    "Example: batch.py list out/ --pending | parallel --sshlogin a,b batch.py one $PWD/out")
    added.add_argument("out", **out)
    added.add_argument("--pending", action="store_true", help="only the numbers of those to render")
    retry(added)
    return top


def positive(text):
    return at_least(1, text)


def at_least_2(text):
    return at_least(2, text)


def at_least(least, text):
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text} is no number from {least} up")
    return int(text)


class Terminated(BaseException):
    """By SIGTERM, as Ctrl-C is by SIGINT."""


def terminate(*_):
    raise Terminated


def main():
    sys.stdout.reconfigure(errors="backslashreplace")
    sys.stderr.reconfigure(errors="backslashreplace")
    signal.signal(signal.SIGTERM, terminate)
    own, passed_on = sys.argv[1:], []
    if "--" in own:
        own, passed_on = own[:own.index("--")], own[own.index("--") + 1:]
    top = parser()
    arguments = top.parse_args(own)
    if passed_on and not arguments.passes_on:
        top.error("options after -- belong to `plan` (for rustle render) and `slurm` (for sbatch)")
    arguments.passed_on = passed_on
    try:
        return arguments.run(arguments)
    except Mistake as mistake:
        print(f"batch.py: {mistake}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # nobody reads on
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        print(f"batch.py: {error.filename or arguments.out}: {error.strerror}; see that there is room and that it may be written", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, Terminated) as ended:
        if arguments.run is not one_command:
            print("batch.py: interrupted; the same command goes on from here", file=sys.stderr)
        return 128 + (signal.SIGTERM if isinstance(ended, Terminated) else signal.SIGINT)


if __name__ == "__main__":
    sys.exit(main())
