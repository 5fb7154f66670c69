"""Stand-ins for what Agones puts around a daemon: the sidecar's REST interface and the allocator's, which can fail, delay and vanish.

They answer as sdk.swagger.json, beta.swagger.json and allocation.swagger.json of Agones have it: whole numbers of 64 bits are texts.
"""
import http.server
import json
import socket
import threading
import time


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


class _Server:
    """A server that comes and goes at one port."""

    def __init__(self, port=None, address="127.0.0.1"):
        self.address, self.port = address, port or free_ports(1)[0]
        self.status = None  # with what all is refused
        self.delay_s = 0.0
        self._server = None

    def come(self):
        serve = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def _serve(self):
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                time.sleep(serve.delay_s)
                status, told = (serve.status, {"message": "no"}) if serve.status else serve.answer(self.command, self.path, body)
                data = json.dumps(told).encode()
                try:
                    self.send_response(status)
                    self.send_header("Content-Type", "application/json")
                    self.send_header("Content-Length", str(len(data)))
                    self.end_headers()
                    self.wfile.write(data)
                except OSError:  # who asked has not waited
                    pass

            do_GET = do_POST = do_PATCH = do_PUT = _serve

            def log_message(self, *_):
                pass

        class Server(http.server.ThreadingHTTPServer):
            daemon_threads = True
            allow_reuse_address = True
            block_on_close = False

        self._server = Server((self.address, self.port), Handler)
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        return self

    def vanish(self):
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None

    close = vanish

    def __enter__(self):
        return self.come()

    def __exit__(self, *_):
        self.vanish()


class Sidecar(_Server):
    """The SDK server beside one daemon; keeps its GameServer and what it was asked."""

    def __init__(self, port=None, ports=None, counters=("sessions",)):
        super().__init__(port)
        self.state = "Scheduled"
        self.name, self.node = "rustle-x7", "203.0.113.4"
        self.ports = ports or {}
        self.counters = {name: {"count": 0, "capacity": 150} for name in counters}
        self.asked = []  # (time, "POST /ready", body)
        self.looks = {}  # by request: called when it comes, what it gives is kept in `seen`
        self.seen = []

    def count(self, request):
        return sum(asked == request for _, asked, _ in self.asked)

    @property
    def sessions(self):
        return self.counters["sessions"]["count"]

    def answer(self, verb, path, body):
        request = f"{verb} {path}"
        if request in self.looks:
            self.seen.append(self.looks[request]())
        self.asked.append((time.monotonic(), request, body.decode()))
        states = {"POST /ready": "Ready", "POST /allocate": "Allocated", "POST /shutdown": "Shutdown", "POST /health": self.state}
        if request in states:
            if json.loads(body) != {}:
                return 400, {"message": "the body is to be empty"}
            self.state = states[request]
            return 200, {}
        if request == "GET /gameserver":
            return 200, {"object_meta": {"name": self.name, "namespace": "default", "labels": {}},
                         "spec": {"health": {"period_seconds": 5, "failure_threshold": 3}},
                         "status": {"state": self.state, "address": self.node,
                                    "ports": [{"name": name, "port": port} for name, port in self.ports.items()],
                                    "counters": {name: {key: str(value) for key, value in counter.items()}
                                                 for name, counter in self.counters.items()}}}
        if verb == "PATCH" and path.startswith("/v1beta1/counters/"):
            return self._change(path.rpartition("/")[2], json.loads(body))
        return 404, {"code": 5, "message": "Not Found"}

    def _change(self, name, asked):
        if name not in self.counters:
            return 404, {"code": 5, "message": f"counter not found: {name}"}
        if not asked or not set(asked) <= {"count", "capacity", "countDiff"} or not all(isinstance(value, str) for value in asked.values()):
            return 400, {"code": 3, "message": "malformed"}
        now = self.counters[name]
        capacity = int(asked.get("capacity", now["capacity"]))
        count = int(asked.get("count", now["count"])) + int(asked.get("countDiff", 0))
        if capacity < 0 or not 0 <= count <= capacity:
            return 400, {"code": 11, "message": "out of range. Count must be within range [0,Capacity]"}
        self.counters[name] = {"count": count, "capacity": capacity}
        return 200, {"name": name, "count": str(count), "capacity": str(capacity)}


class Allocator(_Server):
    """The allocator service in front of daemons that are given as dictionaries:
    {"name", "state", "address", "ports": {...}, "count", "capacity"}."""

    def __init__(self, daemons, fleet="rustle"):
        super().__init__()
        self.daemons, self.fleet = daemons, fleet
        self.asked = []

    @property
    def url(self):
        return f"http://{self.address}:{self.port}"

    def answer(self, verb, path, body):
        if (verb, path) != ("POST", "/gameserverallocation"):
            return 404, {"code": 5, "message": "Not Found"}
        question = json.loads(body)
        self.asked.append(question)
        descending = question["priorities"][0]["order"] == "Descending"
        for selector in question["gameServerSelectors"]:
            if selector["matchLabels"] != {"agones.dev/fleet": self.fleet}:
                continue
            least = int(selector["counters"]["sessions"]["minAvailable"])
            fit = [daemon for daemon in self.daemons
                   if daemon["state"].upper() == selector["gameServerState"] and daemon["capacity"] - daemon["count"] >= least]
            fit.sort(key=lambda daemon: daemon["capacity"] - daemon["count"], reverse=descending)
            if fit:
                action = question["counters"]["sessions"]
                fit[0]["count"] += int(action["amount"]) if action["action"] == "Increment" else 0
                fit[0]["state"] = "Allocated"
                return 200, {"gameServerName": fit[0]["name"], "address": fit[0]["address"], "nodeName": "node-1",
                             "ports": [{"name": name, "port": port} for name, port in fit[0]["ports"].items()],
                             "counters": {"sessions": {"count": str(fit[0]["count"]), "capacity": str(fit[0]["capacity"])}}}
        return 429, {"code": 8, "message": "there is no available GameServer to allocate"}
