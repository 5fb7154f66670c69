"""Rustle's Python SDK, wherever it is: installed, or in the add-on's own folder."""
import pathlib
import sys

OWN = pathlib.Path(__file__).parent / "sdk"
DEBIAN = {"zmq": "python3-zmq", "google": "python3-protobuf", "numpy": "python3-numpy"}


class Problem(Exception):
    """A sentence of what is wrong and one of what to do about it."""


def load():
    """The module `rustle`. Error: Problem."""
    if OWN.is_dir() and str(OWN) not in sys.path:
        sys.path.append(str(OWN))
    try:
        import rustle
    except ImportError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in DEBIAN:
            raise Problem(f"Blender's Python has no module {missing}. On Debian: apt install {DEBIAN[missing]}.") from None
        raise Problem("Rustle's Python SDK is not here. Make the add-on anew with client_sdk/blender/package.sh.") from None
    return rustle


def words(error):
    """A RustleError's message and remedy, without its code."""
    message = error.message if error.message.endswith(".") else error.message + "."
    return f"{message} {error.remedy}".strip()
