"""An array of Slurm's whose tasks render a batch, piece by piece."""
import re
import shlex
import shutil
import subprocess

from engines import command_of_one
from plan import Mistake

ARRAY_SIZE = 1001  # Slurm's own default


def array_size():
    """Slurm's MaxArraySize here: a task's number stays below it."""
    try:
        told = subprocess.run(["scontrol", "show", "config"], capture_output=True, text=True, timeout=30).stdout
    except (OSError, subprocess.TimeoutExpired):
        told = ""
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", told, re.MULTILINE)
    return int(found[1]) if found else ARRAY_SIZE


def in_ranges(numbers):
    """[1, 2, 3, 7] as "1-3,7"."""
    ranges = []
    for number in numbers:
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ",".join(str(first) if first == last else f"{first}-{last}" for first, last in ranges)


def script_of(plan, pending, most_tasks, per_task, at_once, retry):
    """(text, number of tasks, captures a task) of an array whose task t renders the t-th piece of the plan; only pieces with something
    pending are in it."""
    total = len(plan.captures)
    per_task = per_task or -(-total // most_tasks)
    tasks = sorted({(number - 1) // per_task + 1 for number in pending})
    if tasks[-1] > most_tasks:
        raise Mistake(f"{per_task} captures a task make more tasks than an array of Slurm's takes here ({most_tasks}); leave --per-task out, or say "
                      f"{-(-total // most_tasks)} at least")
    array = in_ranges(tasks) + (f"%{at_once}" if at_once else "")
    output = str(plan.out / "slurm").replace("%", "%%") + "/%A_%a.txt"
    command = shlex.join(command_of_one(plan, *(["--retry"] if retry else [])))
    return f"""#!/bin/bash
#SBATCH --job-name=rustle-batch
#SBATCH --array={array}
#SBATCH --cpus-per-task=1
#SBATCH --output="{output}"
last=$((SLURM_ARRAY_TASK_ID * {per_task}))
exec {command} $((last - {per_task} + 1))-$((last < {total} ? last : {total}))
""", len(tasks), per_task


def submit(script, wait, options):
    """The job's number. Mistake where Slurm does not take it."""
    if not shutil.which("sbatch"):
        raise Mistake(f"sbatch is not here; on a machine of the cluster: sbatch {shlex.quote(str(script))}")
    try:
        done = subprocess.run(["sbatch", "--parsable", *(["--wait"] if wait else []), *options, str(script)], capture_output=True, text=True)
    except KeyboardInterrupt:
        raise Mistake("no longer waiting; the job goes on (`squeue` shows it, `scancel` ends it)") from None
    job = done.stdout.strip().split(";")[0]
    if not job:
        raise Mistake(f"sbatch refuses: {done.stderr.strip()}; options for it go after --, as in `slurm OUT --submit -- --partition=short`")
    return job
