"""What a session has said that still holds: what a daemon that starts anew must be told. Not for applications."""
from __future__ import annotations

from .v1 import scene_pb2, session_pb2, sheet_pb2

REPLACED_TOPOLOGIES = 64  #: used before and replaced by a newer one; a daemon keeps as many
WAITING_TOPOLOGIES = 1024  #: sent and not yet used


class Standing:
    """Sheets, topologies, the scene and the listener as of the newest message taken. Pure; knows no socket."""

    def __init__(self) -> None:
        self.newest_time_s: float | None = None
        self.ended = False
        self._sheets: dict[int, sheet_pb2.Sheet] = {}
        self._topologies: dict[int, sheet_pb2.Topology] = {}  # the most recently used last
        self._used: set[int] = set()
        self._current: dict[int, int] = {}  # of each sheet
        self._obstacles: dict[int, scene_pb2.Obstacle] = {}
        self._scene_time_s = 0.0
        self._listener: scene_pb2.Listener | None = None

    def take(self, message: session_pb2.StreamMessage) -> None:
        body = message.WhichOneof("body")
        if body in ("frame", "scene", "listener", "advance", "tear_tips"):
            time_s: float = getattr(message, body).time_s
            self.newest_time_s = time_s if self.newest_time_s is None else max(self.newest_time_s, time_s)
        if body == "sheet":
            self._sheets[message.sheet.sheet_id] = message.sheet
        elif body == "topology":
            self._topologies.setdefault(message.topology.topology_id, message.topology)
            self._forget_topologies()
        elif body == "frame":
            self._use(message.frame.sheet_id, message.frame.topology_id)
        elif body == "scene":
            self._change(message.scene)
        elif body == "listener":
            self._listener = message.listener
        elif body == "end":
            self.ended = True

    def messages(self) -> list[session_pb2.StreamMessage]:
        """In the order in which they are to be sent; neither numbered nor addressed."""
        told = [session_pb2.StreamMessage(sheet=sheet) for sheet in self._sheets.values()]
        told += [session_pb2.StreamMessage(topology=topology) for topology in self._topologies.values()]
        if self._obstacles:
            scene = scene_pb2.SceneUpdate(time_s=self._scene_time_s, obstacles=self._obstacles.values())
            told.append(session_pb2.StreamMessage(scene=scene))
        if self._listener is not None:
            told.append(session_pb2.StreamMessage(listener=self._listener))
        return told

    def _use(self, sheet_id: int, topology_id: int) -> None:
        self._current[sheet_id] = topology_id
        if topology_id not in self._topologies:
            return
        self._topologies[topology_id] = self._topologies.pop(topology_id)
        if topology_id not in self._used:
            self._used.add(topology_id)
            self._forget_topologies()

    def _forget_topologies(self) -> None:
        current = set(self._current.values())
        replaced = [known for known in self._topologies if known in self._used and known not in current]
        waiting = [known for known in self._topologies if known not in self._used]
        too_many = replaced[:max(0, len(replaced) - REPLACED_TOPOLOGIES)] + waiting[:max(0, len(waiting) - WAITING_TOPOLOGIES)]
        for old in too_many:
            del self._topologies[old]
            self._used.discard(old)

    def _change(self, update: scene_pb2.SceneUpdate) -> None:
        self._scene_time_s = update.time_s
        for obstacle in update.obstacles:
            kept = scene_pb2.Obstacle()
            kept.CopyFrom(obstacle)
            self._obstacles[obstacle.obstacle_id] = kept
        for moved in update.poses:
            if moved.obstacle_id in self._obstacles:
                self._obstacles[moved.obstacle_id].pose.CopyFrom(moved.pose)
        for deformed in update.vertices:
            known = self._obstacles.get(deformed.obstacle_id)
            if known is not None and known.HasField("mesh"):
                known.mesh.vertices = deformed.vertices
        for obstacle_id in update.removed_obstacle_ids:
            self._obstacles.pop(obstacle_id, None)
