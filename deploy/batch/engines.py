"""Who runs the commands of this machine, one for each capture: GNU parallel, or processes of our own."""
import pathlib
import selectors
import shutil
import signal
import subprocess
import sys

COMMAND = str(pathlib.Path(__file__).resolve().with_name("batch.py"))


def command_of_one(plan, *more):
    return [sys.executable, COMMAND, "one", str(plan.out), *more]


def gnu_parallel():
    """Path of GNU parallel, or None; moreutils has another program of that name."""
    found = shutil.which("parallel")
    if found:
        told = subprocess.run([found, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True).stdout
        if told.startswith("GNU parallel"):
            return found
    return None


def through_parallel(program, command, numbers, jobs):
    """Yields a line for each capture as it ends. Ends its processes when closed."""
    process = subprocess.Popen([program, "--plain", "--will-cite", "--quote", "--jobs", str(jobs), *command], text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        process.stdin.write("".join(f"{number}\n" for number in numbers))
        process.stdin.close()
        yield from process.stdout
        process.wait()
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            process.wait()


def through_pool(command, numbers, jobs):
    """The same with processes of our own."""
    running, left = set(), list(reversed(numbers))
    with selectors.DefaultSelector() as outputs:
        try:
            while running or left:
                while left and len(running) < jobs:
                    process = subprocess.Popen([*command, str(left.pop())], text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
                    outputs.register(process.stdout, selectors.EVENT_READ, process)
                    running.add(process)
                for ready, _ in outputs.select():
                    outputs.unregister(ready.fileobj)
                    said = ready.data.communicate()[0]
                    running.remove(ready.data)
                    yield from said.splitlines()
        finally:
            for process in running:
                process.terminate()
            for process in running:
                process.communicate()
