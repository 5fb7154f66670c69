#!/usr/bin/python3
"""Injects every fault of the table into a running rustled and prints a line each: injected, expected, seen.
usage: faults.py [--quick] [NAME ...]     see run.sh
"""
import sys
import time

# In the order of the table.
import of_clients
import of_networks
import of_systems
import of_captures
from table import TABLE


def main():
    names = [name for name in sys.argv[1:] if not name.startswith("-")]
    unknown = set(names) - {row[0] for row in TABLE}
    if unknown or "--help" in sys.argv:
        print(__doc__ + "names: " + ", ".join(row[0] for row in TABLE))
        return 2 if unknown else 0
    broken = 0
    for name, injected, expected, inject in TABLE:
        if names and name not in names:
            continue
        begun = time.monotonic()
        try:
            seen, holds = inject(), True
        except Exception as error:  # a fault that does not hold is a line as well
            seen, holds = f"{type(error).__name__}: {error}", False
        broken += not holds
        print(f"{'holds' if holds else 'BROKEN':<7} {name}: {injected} | {expected} | {seen} ({time.monotonic() - begun:.0f} s)", flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
