"""The table of faults: what is injected, and what is expected."""
import sys

QUICK = "--quick" in sys.argv
TABLE = []


def fault(injected, expected):
    """Declares a row; the function injects, asserts, and returns what was seen."""
    def declare(function):
        TABLE.append((function.__name__, injected, expected, function))
        return function
    return declare


def often(many, few):
    return few if QUICK else many
