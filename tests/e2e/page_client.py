"""A browser's part of the page's wire, by plain sockets: a WebSocket client, and what the daemon says to it, decoded."""
import base64
import json
import os
import socket
import struct
import time

import numpy as np

PROTOCOL = "rustle.page.1"


class Refused(Exception):
    def __init__(self, status, body):
        super().__init__(f"{status}: {body}")
        self.status, self.body = status, body


class Closed(Exception):
    def __init__(self, code=None, reason=""):
        super().__init__(f"{code} {reason}")
        self.code, self.reason = code, reason


class Page:
    """Looks at a daemon. Everything it hears stays in `heard`, texts as dicts, binary messages as (kind, ...)."""

    def __init__(self, address, origin=None, host=None, protocol=PROTOCOL, receive_buffer=None, path="/live"):
        name, port = address.rsplit(":", 1)
        host = address if host is None else host
        origin = f"http://{host}" if origin is None else origin
        self.socket = socket.socket(socket.AF_INET6 if ":" in name else socket.AF_INET)
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(20)
        self.socket.connect((name, int(port)))
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade", f"Sec-WebSocket-Key: {key}",
                 "Sec-WebSocket-Version: 13"]
        lines += [f"Origin: {origin}"] if origin else []
        lines += [f"Sec-WebSocket-Protocol: {protocol}"] if protocol else []
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.bytes, self.heard, self.over = b"", [], None
        while b"\r\n\r\n" not in self.bytes:
            self._receive()
        head, self.bytes = self.bytes.split(b"\r\n\r\n", 1)
        self.head = head.decode()
        status = int(self.head.split(" ", 2)[1])
        if status != 101:
            self.socket.settimeout(1)
            try:
                while True:
                    self._receive()
            except (Closed, socket.timeout):
                pass
            self.close()
            raise Refused(status, self.bytes.decode())

    def _receive(self):
        more = self.socket.recv(1 << 16)
        if not more:
            raise Closed()
        self.bytes += more

    # ---- out

    def send(self, type_, **fields):
        self.send_raw(json.dumps({"type": type_, **fields}).encode())

    def send_raw(self, payload, opcode=1):
        mask = os.urandom(4)
        size = bytes([0x80 | len(payload)]) if len(payload) < 126 else struct.pack("!BH", 0x80 | 126, len(payload))
        masked = bytes(byte ^ mask[k % 4] for k, byte in enumerate(payload))
        self.socket.sendall(bytes([0x80 | opcode]) + size + mask + masked)

    # ---- in

    def _take_frame(self):
        """(opcode, payload) of a frame that is whole; None: not yet."""
        if len(self.bytes) < 2:
            return None
        size, at = self.bytes[1] & 0x7f, 2
        if size == 126:
            size, at = int.from_bytes(self.bytes[2:4], "big"), 4
        elif size == 127:
            size, at = int.from_bytes(self.bytes[2:10], "big"), 10
        if len(self.bytes) < at + size:
            return None
        opcode, payload = self.bytes[0] & 0x0f, self.bytes[at:at + size]
        assert self.bytes[0] & 0x80, "messages come in one piece"
        self.bytes = self.bytes[at + size:]
        return opcode, payload

    def next(self, seconds=10):
        """The next message; None: none within that time."""
        deadline = time.monotonic() + seconds
        while True:
            frame = self._take_frame()
            if frame is None:
                rest = deadline - time.monotonic()
                if rest <= 0:
                    return None
                self.socket.settimeout(rest)
                try:
                    self._receive()
                except socket.timeout:
                    return None
                except ConnectionError:
                    raise Closed() from None
                continue
            opcode, payload = frame
            if opcode == 9:
                self.send_raw(payload, 10)
            elif opcode == 8:
                raise Closed(int.from_bytes(payload[:2], "big"), payload[2:].decode())
            elif opcode == 1:
                self.heard.append(json.loads(payload))
                return self.heard[-1]
            elif opcode == 2:
                self.heard.append(decode(payload))
                return self.heard[-1]

    def until(self, wanted, seconds=15, what="it"):
        """The first message from now on that is wanted: a kind, or a condition."""
        condition = (lambda message: kind_of(message) == wanted) if isinstance(wanted, str) else wanted
        deadline = time.monotonic() + seconds
        while (rest := deadline - time.monotonic()) > 0:
            message = self.next(rest)
            if message is not None and condition(message):
                return message
        raise AssertionError(f"{wanted if isinstance(wanted, str) else what} did not come within {seconds} s; last heard: "
                             f"{[kind_of(message) for message in self.heard[-20:]]}")

    def listen_for(self, seconds):
        """All that comes within that time."""
        begin, deadline = len(self.heard), time.monotonic() + seconds
        while (rest := deadline - time.monotonic()) > 0:
            self.next(rest)
        return self.heard[begin:]

    def of_kind(self, kind):
        return [message for message in self.heard if kind_of(message) == kind]

    def close(self):
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *why):
        self.close()


def kind_of(message):
    return message["type"] if isinstance(message, dict) else message[0]


def decode(payload):
    """("topology", sheet, vertices, triangles) and so on."""
    kind, place = struct.unpack_from("<II", payload)
    if kind == 1:
        vertices, triangles = struct.unpack_from("<II", payload, 8)
        assert len(payload) == 16 + 12 * triangles
        return "topology", place, vertices, np.frombuffer(payload, "<u4", 3 * triangles, 16).reshape(-1, 3)
    if kind == 2:
        time_s, vertices, ridges, rulings = struct.unpack_from("<dIII", payload, 8)
        at = 28 + 12 * vertices
        positions = np.frombuffer(payload, "<f4", 3 * vertices, 28).reshape(-1, 3)
        regions = np.frombuffer(payload, "<u2", vertices, at)
        at = (at + 2 * vertices + 3) // 4 * 4
        segments = np.frombuffer(payload, "<f4", 6 * (ridges + rulings), at).reshape(-1, 2, 3)
        assert len(payload) == at + 24 * (ridges + rulings)
        return "frame", place, time_s, positions, regions, segments[:ridges], segments[ridges:]
    if kind == 3:
        first, channels, frames = struct.unpack_from("<QII", payload, 8)
        assert len(payload) == 24 + 4 * channels * frames
        return "pcm", first, np.frombuffer(payload, "<f4", channels * frames, 24).reshape(frames, channels)
    assert kind == 4, kind
    vertices, triangles = struct.unpack_from("<II", payload, 8)
    assert len(payload) == 16 + 12 * (vertices + triangles)
    return ("obstacle", place, np.frombuffer(payload, "<f4", 3 * vertices, 16).reshape(-1, 3),
            np.frombuffer(payload, "<u4", 3 * triangles, 16 + 12 * vertices).reshape(-1, 3))
