"""What a simulator and the daemon say to each other, as plain data.

Lengths are in the session's units (metres unless SessionOptions say otherwise), in the session's axes; times are seconds of
simulation time. Arrays are NumPy arrays; their shapes stand in brackets: V vertices, T triangles.
"""
from __future__ import annotations

import dataclasses
import enum
from collections.abc import Sequence
from typing import Any, Union

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
Array = npt.NDArray[Any]
Vector3 = Sequence[float]  #: x, y, z
Quaternion = Sequence[float]  #: w, x, y, z


class Clock(enum.Enum):
    LIVE = "live"  #: paced by the audio clock; sending never waits
    SIMULATION = "simulation"  #: PCM follows simulation time; flow-controlled, nothing is dropped


class UpAxis(enum.Enum):
    Z = "z"
    Y = "y"


class SynthesisMode(enum.Enum):
    CORRECTED = "corrected"
    PUBLISHED = "published"  #: the papers' formulas as printed


class Channels(enum.Enum):
    MONO = "mono"
    STEREO = "stereo"
    BINAURAL = "binaural"


class SheetKind(enum.Enum):
    PAPER = "paper"
    CLOTH = "cloth"


class SoundKind(enum.Enum):
    CRUMPLING = "crumpling"
    FRICTION = "friction"
    TEARING = "tearing"


class SampleFormat(enum.Enum):
    F32 = "f32"
    S16 = "s16"
    OPUS = "opus"  #: 64 kbit/s a channel in packets of 20 ms; decoded by the system's libopus


class NoticeLevel(enum.Enum):
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Sent(enum.Enum):
    QUEUED = "queued"  #: on its way
    DROPPED = "dropped"  #: LIVE clock only: the queue was full, or the daemon is away; counted


@dataclasses.dataclass(frozen=True)
class Endpoints:
    """Where the daemon is. Empty: asked from the daemon."""

    control: str = "tcp://127.0.0.1:7390"
    stream: str = ""
    out: str = ""


@dataclasses.dataclass(frozen=True)
class SheetOptions:
    id: int = 1
    name: str = ""
    kind: SheetKind = SheetKind.PAPER
    material: str = ""  #: a sound pack's, such as "printer-paper"; empty: the session's default
    touched_surface: str = ""  #: empty: "wooden-table"
    grammage_kg_per_m2: float | None = None
    thickness_m: float | None = None


@dataclasses.dataclass(frozen=True)
class SessionOptions:
    name: str = ""  #: for people
    clock: Clock = Clock.LIVE
    time_origin_s: float = 0.0  #: the simulation time of the first sample
    metres_per_unit: float = 1.0
    up_axis: UpAxis = UpAxis.Z
    seed: int = 0
    mode: SynthesisMode = SynthesisMode.CORRECTED
    playout_delay_s: float | None = None  #: None: the daemon's choice
    rate_hz: int = 0  #: 0: the daemon's
    block_size: int = 0  #: 0: the daemon's
    channels: Channels = Channels.STEREO
    default_material: str = ""  #: empty: "printer-paper"
    record: bool = False  #: the daemon records the session from its first sample on
    hrtf: str = ""  #: binaural: "structural", "kemar" or one the daemon offers; empty: the daemon's
    friction_fft_size: int = 0  #: a power of two, 128 to 8192; 0: the daemon's
    most_voices: int = 0  #: at a time, 1 to 512; 0: 512, or what the key may have
    sheets: Sequence[SheetOptions] = ()  #: more may follow by add_sheet()


@dataclasses.dataclass(frozen=True)
class ContactPartner:
    id: int = 0
    is_sheet: bool = False  #: else an obstacle


@dataclasses.dataclass(frozen=True)
class Contacts:
    """Contacts that the simulator knows, one entry each in parallel arrays. Without any: the sheet touches nothing."""

    vertices: Array = dataclasses.field(default_factory=lambda: np.zeros(0, np.uint32))  #: [C] whole numbers below V
    partners: Array = dataclasses.field(default_factory=lambda: np.zeros(0, np.uint32))  #: [C] into the table
    partner_table: Sequence[ContactPartner] = ()
    slip_velocities: Floats | None = None  #: [C,3] float32, units per second
    normal_forces: Floats | None = None  #: [C] float32, newtons: what is pressed is louder; absent: its own weight


@dataclasses.dataclass(frozen=True)
class Partition:
    """The simulator's own partition into developable regions. R regions, L rulings, S singular points."""

    triangle_regions: Array  #: [T] whole numbers below R; 0xffffffff: none
    region_curved: Array  #: [R] bool or uint8
    rulings: Floats  #: [L,6] float32: two ends
    ruling_regions: Array  #: [L] whole numbers below R
    singular_points: Floats  #: [S,3] float32
    singular_on_border: Array | None = None  #: [S] bool or uint8


@dataclasses.dataclass(frozen=True)
class TearTip:
    id: int
    position: Vector3
    speed: float = 0.0  #: units per second
    direction: Vector3 | None = None


@dataclasses.dataclass(frozen=True)
class Pose:
    position: Vector3 = (0.0, 0.0, 0.0)
    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Plane:
    """Solid below; the normal need not have unit length."""

    point: Vector3 = (0.0, 0.0, 0.0)
    normal: Vector3 = (0.0, 0.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Box:
    half_extents: Vector3


@dataclasses.dataclass(frozen=True)
class Sphere:
    radius: float


@dataclasses.dataclass(frozen=True)
class Capsule:
    """Along z from -half_length to +half_length, caps beyond."""

    radius: float
    half_length: float


@dataclasses.dataclass(frozen=True)
class Mesh:
    triangles: Array  #: [T,3] whole numbers below V
    vertices: Floats  #: [V,3] float32


Shape = Union[Plane, Box, Sphere, Capsule, Mesh]


@dataclasses.dataclass(frozen=True)
class Obstacle:
    id: int
    shape: Shape
    pose: Pose = Pose()
    name: str = ""
    surface_material: str = ""  #: empty: the sheet's touched_surface
    reflecting: bool = False  #: planes only
    reflection_coefficient: float = 1.0  #: of pressure, 0 to 1


@dataclasses.dataclass(frozen=True)
class Gain:
    """A sound's level is the product of all gains that concern it."""

    gain_db: float = 0.0  #: -200 to 24, or -math.inf: silence
    sheet_id: int | None = None  #: None: every sheet
    kind: SoundKind | None = None  #: None: every kind
    material: str = ""  #: empty: every material


@dataclasses.dataclass(frozen=True)
class ServerInfo:
    server: str
    stream_endpoint: str
    out_endpoint: str
    rate_hz: int
    block_size: int
    sessions: int = 0  #: there, when it was asked
    most_sessions: int = 0  #: there may be; 0: it does not say


@dataclasses.dataclass(frozen=True)
class PackInfo:
    name: str
    material: str
    touched_surface: str
    version: str
    licence: str
    rate_hz: int
    units: int
    spectra: int
    models: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class RecordingInfo:
    """A file in the daemon's recording folder."""

    file_name: str
    messages: int
    bytes: int


@dataclasses.dataclass(frozen=True)
class SessionInfo:
    session_id: str
    name: str
    clock: Clock
    sheets: int
    newest_time_s: float
    recording: RecordingInfo | None = None  #: of a session that is recorded: so far


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Figures of a session, as proto/rustle/v1/session.proto says of each.

    frames_received = frames_analysed + the sum of frames_dropped + frames that wait.
    """

    session_id: str = ""
    messages_received: int = 0
    frames_received: int = 0
    frames_analysed: int = 0
    frames_dropped: dict[str, int] = dataclasses.field(default_factory=dict)  #: by cause
    messages_refused: int = 0
    sequence_gaps: int = 0
    samples_due: int = 0
    samples_sent: int = 0
    samples_in_gaps: int = 0
    voices: int = 0
    voices_most: int = 0
    voices_stolen: int = 0
    voices_dropped: int = 0
    sources_dropped: int = 0
    cues_dropped: int = 0
    sounds_missing: int = 0
    planes_left_out: int = 0
    samples_limited: int = 0
    samples_not_finite: int = 0
    voices_merged: int = 0
    emitter_samples_left_out: int = 0
    frames_late: int = 0
    time_jumps: int = 0
    input_gaps: int = 0
    samples_in_input_gaps: int = 0
    pcm_gaps: int = 0
    deadline_misses: int = 0
    late_by_run_delay: int = 0
    events_joined: int = 0
    crumpling_events: int = 0
    friction_episodes: int = 0
    tear_events: int = 0
    newest_time_s: float = 0.0
    rendered_time_s: float = 0.0
    playout_delay_s: float = 0.0
    clock_drift_ppm: float = 0.0
    load_level: int = 0


@dataclasses.dataclass(frozen=True)
class ThreadStatistics:
    name: str
    count: int
    cpu_s: float
    waited_s: float  #: ready to run while others had the processors


@dataclasses.dataclass(frozen=True)
class PlaybackStatistics:
    device: str  #: empty: none answers
    rate_hz: int
    samples_played: int
    samples_missed: int
    devices_opened: int
    devices_lost: int
    samples_in_gaps: int
    samples_left_out: int
    splices: int


@dataclasses.dataclass(frozen=True)
class ServerStatistics:
    """Figures of the daemon, as proto/rustle/v1/session.proto says of each."""

    uptime_s: float
    cpu_s: float
    sessions: int
    threads: tuple[ThreadStatistics, ...]
    playback: PlaybackStatistics | None  #: None: it plays nothing


@dataclasses.dataclass(frozen=True)
class Notice:
    """What the daemon says about a stream message."""

    level: NoticeLevel
    code: str  #: such as "unknown_topology"
    field: str
    message: str
    remedy: str
    sequence: int = 0  #: of the message it is about; 0: none
    count: int = 1  #: how often since the last notice of this code

    def __str__(self) -> str:
        where = f" in {self.field}" if self.field else ""
        times = f" ({self.count} times)" if self.count > 1 else ""
        return f"{self.code}{where}: {self.message} {self.remedy}{times}"
