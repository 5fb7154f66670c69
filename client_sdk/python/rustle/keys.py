"""CURVE keys: who one is, and which daemon one speaks to."""
from __future__ import annotations

import dataclasses
import os
import pathlib

import zmq.auth

from .errors import InvalidArgument


@dataclasses.dataclass(frozen=True)
class Keys:
    """Z85 texts of 40 characters each.

        daemon = rustle.Connection.connect("tcp://sound.example.org:7390", keys=rustle.Keys.read("my-keys"))
    """

    public_key: str
    secret_key: str = dataclasses.field(repr=False)
    server_key: str  #: the daemon's public key, pinned: whoever answers without its secret is not talked to

    @staticmethod
    def read(folder: str | os.PathLike[str]) -> Keys:
        """From a folder with one NAME.key_secret, one's own, and server.key, the daemon's, as `rustle keys` and pyzmq's
        zmq.auth.create_certificates write them.

        Error: InvalidArgument ("keys"), where one of them is missing or no key, or several secrets are there.
        """
        place = pathlib.Path(folder)
        secrets = sorted(place.glob("*.key_secret"))
        if len(secrets) != 1:
            raise InvalidArgument("keys", f"{place}: there are {len(secrets)} files NAME.key_secret, not one.",
                                  "Make a pair with `rustle keys new NAME`, and leave one in the folder.")
        public, secret = _load(secrets[0])
        server, _ = _load(place / "server.key")
        if secret is None:
            raise InvalidArgument("keys", f"{secrets[0]}: it holds no secret-key.", "Make a pair with `rustle keys new NAME`.")
        return Keys(public, secret, server)


def _load(file: pathlib.Path) -> tuple[str, str | None]:
    try:
        public, secret = zmq.auth.load_certificate(file)
        return public.decode(), None if secret is None else secret.decode()
    except (OSError, ValueError) as error:
        raise InvalidArgument("keys", f"{file}: {error}.", "Take server.key from the daemon's operator, and make a pair of "
                              "your own with `rustle keys new NAME`.") from None
