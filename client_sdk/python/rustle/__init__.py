"""Rustle's Python SDK: attach a simulator to `rustled`, send its sheets, hear them.

    connection = rustle.Connection.connect()                  what is asked and answered: sessions, packs, statistics
    session = rustle.Session.attach(connection, options)      what has a time: topologies, frames, scene, listener, end
    reader = session.listen()                                 sound, as float32 [samples, channels]
    async with session.listen_async() as reader: ...          the same for asyncio
    session = rustle.fleet.attach(places, options)            at one daemon of many, and at another when that goes away

Positions are float32 [V,3] arrays in the session's units, indices count from 0, times are seconds of simulation time.
Errors are RustleErrors with `field` and `remedy`. A Connection serves any thread; a Session or a reader one at a time.
"""
from . import fleet, sheets
from .async_readers import AsyncObservationReader, AsyncPcmReader
from .connection import Connection
from .errors import Closed, InvalidArgument, Refused, RustleError, SessionLost, TimedOut, Unreachable
from .keys import Keys
from .notices import log_notice, raise_notice
from .observations import Observation, ObservationReader, ObservedCrumpling, ObservedFriction, ObservedResonator
from .pcm import Emitters, EmitterState, Gap, ListenOptions, Mix, PcmBlock, PcmReader, Sound, Stem
from .session import Session
from .types import (Box, Capsule, Channels, Clock, ContactPartner, Contacts, Endpoints, Gain, Mesh, Notice, NoticeLevel,
                    Obstacle, PackInfo, Partition, Plane, PlaybackStatistics, Pose, RecordingInfo, SampleFormat, Sent, ServerInfo,
                    ServerStatistics, SessionInfo, SessionOptions, SheetKind, SheetOptions, SoundKind, Sphere, Statistics,
                    SynthesisMode, TearTip, ThreadStatistics, UpAxis)

__version__ = "0.1.0"

__all__ = [
    "AsyncObservationReader", "AsyncPcmReader", "Box", "Capsule", "Channels", "Clock", "Closed", "Connection", "ContactPartner", "Contacts", "EmitterState", "Emitters",
    "Endpoints", "Gain", "Gap", "InvalidArgument", "Keys", "ListenOptions", "Mesh", "Mix", "Notice", "NoticeLevel", "Observation",
    "ObservationReader", "ObservedCrumpling", "ObservedFriction", "ObservedResonator", "Obstacle", "PackInfo", "Partition",
    "PcmBlock", "PcmReader", "Plane", "PlaybackStatistics", "Pose", "RecordingInfo", "Refused", "RustleError", "SampleFormat",
    "Sent", "ServerInfo", "ServerStatistics", "Session", "SessionInfo", "SessionLost", "SessionOptions", "SheetKind",
    "SheetOptions", "Sound", "SoundKind", "Sphere", "Statistics", "Stem", "SynthesisMode", "TearTip", "ThreadStatistics",
    "TimedOut", "Unreachable", "UpAxis", "fleet", "log_notice", "raise_notice", "sheets",
]
