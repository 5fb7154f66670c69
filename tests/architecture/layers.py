#!/usr/bin/python3
"""Holds every folder to the layers its CMake lines declare: layers.py LAYERS_FILE SOURCE_DIR

LAYERS_FILE has a line per module, in the order of the layers: `name folder depends...`. A file of a folder may include
from its own folder and from the folders it names; a folder may name only folders above it; generated messages and
ZeroMQ belong to the modules that speak the wire. A .cpp includes the header of its name before all others, which
shows that the header needs nothing before it.
"""
import pathlib
import re
import sys

WIRE_HEADERS = re.compile(r"\.pb\.h$|^zmq")
WIRE_MODULES = {"client", "capture", "wire", "test_support"}
INCLUDE = re.compile(r'^\s*#\s*include\s*["<]([^">]+)[">]', re.MULTILINE)


def read_layers(path):
    layers = {}
    for line in pathlib.Path(path).read_text().splitlines():
        name, folder, *depends = line.split()
        layers[name] = (folder, depends)
    return layers


def faults(layers, root):
    folders = {folder: name for name, (folder, _) in layers.items()}
    seen = []
    for name, (folder, depends) in layers.items():
        for other in depends:
            if other not in seen:
                yield f"{folder}: depends on {other}, which is not above it"
        seen.append(name)
        allowed = {name, *depends}
        for file in sorted((root / folder).iterdir()):
            if file.suffix not in (".h", ".cpp"):
                continue
            where = file.relative_to(root)
            includes = INCLUDE.findall(file.read_text())
            header = file.with_suffix(".h")
            if file.suffix == ".cpp" and header.exists() and includes[:1] != [str(header.relative_to(root))]:
                yield f"{where}: includes {header.relative_to(root)} not before all others"
            for include in includes:
                if WIRE_HEADERS.search(include) and folder.startswith(("server", "client_sdk", "sound_db")) and name not in WIRE_MODULES:
                    yield f"{where}: includes {include}; only {sorted(WIRE_MODULES)} speak the wire"
                target = folders.get(str(pathlib.PurePosixPath(include).parent))
                if target and target not in allowed:
                    yield f"{where}: includes {include}, but {name} does not depend on {target}"


def main():
    layers, root = read_layers(sys.argv[1]), pathlib.Path(sys.argv[2])
    found = list(faults(layers, root))
    print("\n".join(found) if found else f"{len(layers)} modules keep to their layers")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
