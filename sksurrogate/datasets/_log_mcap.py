"""Joint logs in MCAP: joint states and commands from topics of ROS 2, ROS 1 or JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate.datasets._log_streams import MOST_NAMES, Asked, Part, Record, Stream, chosen, distinct, renamed, shown
from sksurrogate.exceptions import DataError, SurrogateError, require

#: Fields of a joint state, and what their signals end with.
FIELDS = {"position": ".pos", "velocity": ".vel", "effort": ".effort"}
#: Stamps below (ns; the year 1973) are of a simulated clock, which begins at 0.
SIMULATED = 10**17
#: Encodings of messages and of their definitions that are read.
ENCODINGS = {("cdr", "ros2msg"): "mcap_ros2.decoder", ("ros1", "ros1msg"): "mcap_ros1.decoder"}


@dataclass
class _Topic:
    """A topic of the files."""

    kind: str  #: Name of the schema
    encodings: set[tuple[str, str]] = field(default_factory=set)  #: Of the messages and of the schema
    count: int = 0  #: Messages

    @property
    def has_joints(self) -> bool:
        return self.kind.endswith("JointState")


@dataclass
class _Messages:
    """Messages of one topic with the same signals, in the order of the file."""

    topic: str
    names: tuple[str, ...]
    numbered: bool
    logged: list[int] = field(default_factory=list)  #: ns
    stamped: list[int | None] = field(default_factory=list)  #: ns; None without a stamp in a header
    values: list[list[float]] = field(default_factory=list)


def read_mcap_log(files: Sequence[Path], asked: Asked) -> Record:
    """Readings and commands of one recording, which may be spread over several files."""
    require("mcap", "robots")
    topics = _topics(files)
    commands = asked.commands
    readings = asked.readings or (_joint_topic(files[0].name, topics, commands),)
    for argument, names in (("readings", readings), ("commands", commands)):
        for name in names:
            _check_topic(argument, name, topics)
    found = _collected(files, tuple(dict.fromkeys([*readings, *commands])), topics)
    clock, notes = _clock(found, asked.clock)
    origin = min(min(_times(messages, clock)) for messages in found if messages.topic in readings)
    streams = [_stream(messages, clock, origin, messages.topic in readings, notes) for messages in found]
    read = distinct([stream for stream in streams if stream.source in readings])
    sent = distinct([stream for stream in streams if stream.source in (commands or readings)])
    outputs = _pairs("outputs", asked.outputs, read, (".pos", ".vel"))
    inputs = _pairs("inputs", asked.inputs, sent, (".effort",) if not commands else (), only=not commands)
    if asked.inputs is None and not inputs:
        raise DataError(
            f"inputs=None: {shown(readings)} has no effort; give commands= with the topics of what drives the joints, or inputs=[] for "
            f"none. Topics of the log: {_listed(topics)}."
        )
    rows = tuple(_with_numbers(stream) for stream in renamed(read, outputs))
    part = Part(
        tuple(s for s in rows if len(s.t)), renamed(sent, inputs), apart=not {*readings} >= {*(commands or readings)}
    )
    if not part.readings:
        raise DataError(f"outputs: {list(outputs)} have no number in any message of {shown(readings)}.")
    return Record((part,), tuple(inputs), tuple(outputs), notes=tuple(notes))


def _pairs(
    argument: str, asked: Any, streams: Sequence[Stream], endings: tuple[str, ...], only: bool = False
) -> dict[str, str]:
    """Signals that are asked for; by default those with numbers and these ``endings``, or all of topics without names.

    ``only``: whether signals with other endings may not be asked for.
    """
    known = list(dict.fromkeys(name for stream in streams for name in stream.names))
    known = [name for name in known if name.endswith(endings)] if only else known
    numbers = {n for s in streams for n, some in zip(s.names, ~np.isnan(s.values).all(axis=0)) if some}
    numbered = bool(streams) and all(stream.numbered for stream in streams)
    default = [n for n in known if n in numbers and (numbered or not endings or n.endswith(endings))]
    return chosen(argument, asked, known, default, numbered)


# ---- topics -----------------------------------------------------------------------------------------------------------
def _topics(files: Sequence[Path]) -> dict[str, _Topic]:
    """What the files hold, by topic."""
    topics: dict[str, _Topic] = {}
    for file in files:
        for schema, channel, number in _channels(file):
            kind, encoding = (schema.name, schema.encoding) if schema else ("no schema", "")
            topic = topics.setdefault(channel.topic, _Topic(kind))
            topic.encodings.add((channel.message_encoding, encoding))
            topic.count += number
    return topics


def _channels(file: Path) -> Iterator[tuple[Any, Any, int]]:
    """Schema, channel and number of messages; from the summary of the file where it has one."""
    with _opened(file) as reader:
        summary = reader.get_summary()
        if summary is not None and summary.channels and summary.statistics:
            counts = summary.statistics.channel_message_counts
            for key, channel in summary.channels.items():
                yield summary.schemas.get(channel.schema_id), channel, counts.get(key, 0)
            return
        for schema, channel, _ in reader.iter_messages(log_time_order=False):
            yield schema, channel, 1


@contextmanager
def _opened(file: Path, decoders: Sequence[Any] = ()) -> Iterator[Any]:
    """A reader of an MCAP file; what goes wrong in it is said."""
    make_reader = require("mcap.reader", "robots").make_reader
    with file.open("rb") as stream:
        try:
            yield make_reader(stream, validate_crcs=True, decoder_factories=decoders)
        except SurrogateError:
            raise
        except Exception as error:  # a damaged file fails in a dozen ways
            if type(error).__name__ == "InvalidMagic":
                raise DataError(
                    f"{file.name} is no MCAP file ({error}): give the .mcap file of the recording."
                ) from error
            why = f"{type(error).__name__}: {error}".rstrip(": ")
            raise DataError(
                f"{file.name} is cut off or damaged ({why}): the command line of MCAP keeps what can be read,  mcap recover "
                f"{file.name} -o whole.mcap"
            ) from error


def _joint_topic(file: str, topics: dict[str, _Topic], commands: Sequence[str]) -> str:
    """The only topic of joint states."""
    joints = [name for name, topic in topics.items() if topic.has_joints and name not in commands]
    if len(joints) == 1:
        return joints[0]
    problem = f"several topics of joint states, {joints}" if joints else "no topic of sensor_msgs/JointState"
    raise DataError(
        f"readings=None: {file} has {problem}: name those of the readings, readings=[...]. Topics of the log: {_listed(topics)}."
    )


def _check_topic(argument: str, name: str, topics: dict[str, _Topic]) -> None:
    """A topic with messages that can be read."""
    if name not in topics or not topics[name].count:
        problem = (
            "has no messages in the log;" if name in topics else f"is no topic of the log;{did_you_mean(name, topics)}"
        )
        raise DataError(f"{argument}={name!r} {problem} Topics of the log: {_listed(topics)}.")
    for message, schema in topics[name].encodings:
        if (message, schema) not in ENCODINGS and message != "json":
            raise DataError(
                f"{argument}={name!r} is encoded as {message!r} with definitions in {schema!r}; read are ROS 2 ('cdr', 'ros2msg'), "
                "ROS 1 ('ros1', 'ros1msg') and 'json': write the topic to an NPZ or CSV."
            )


def _listed(topics: dict[str, _Topic]) -> str:
    """Topics as they can stand in a message."""
    told = [f"{name!r} ({topic.kind}, {topic.count} messages)" for name, topic in topics.items()]
    more = [f"{len(told) - MOST_NAMES} more"] if len(told) > MOST_NAMES else []
    return ", ".join([*told[:MOST_NAMES], *more]) or "none"


# ---- messages ---------------------------------------------------------------------------------------------------------
class _Json:
    """Decoder of messages in JSON."""

    def decoder_for(self, message_encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        """A decoder, if the messages are JSON."""
        if message_encoding != "json":
            return None
        return lambda data: json.loads(data, object_hook=lambda fields: SimpleNamespace(**fields))


def _collected(files: Sequence[Path], wanted: Sequence[str], topics: dict[str, _Topic]) -> list[_Messages]:
    """Messages by topic and signals, in the order of the files."""
    modules = {ENCODINGS[pair] for name in wanted for pair in topics[name].encodings if pair in ENCODINGS}
    decoders = [_Json(), *(require(module, "robots").DecoderFactory() for module in sorted(modules))]
    found: dict[tuple[str, tuple[str, ...]], _Messages] = {}
    for file in files:
        with _opened(file, decoders) as reader:
            for _, channel, message, decoded in reader.iter_decoded_messages(wanted, log_time_order=False):
                names, values, numbered = _signals(decoded, channel.topic, topics[channel.topic].kind)
                key = channel.topic, names
                if key not in found:
                    found[key] = _Messages(channel.topic, names, numbered)
                found[key].logged.append(message.log_time)
                found[key].stamped.append(_stamp(decoded))
                found[key].values.append(values)
    _check_widths(found.values())
    return list(found.values())


def _signals(message: Any, topic: str, kind: str) -> tuple[tuple[str, ...], list[float], bool]:
    """Names and values of a joint state, or of an array or number without names (then True)."""
    if hasattr(message, "name") and hasattr(message, "position"):
        return *_joints(message, topic), False
    data = getattr(message, "data", None)
    if isinstance(data, Real):
        return (topic,), [float(data)], True
    if isinstance(data, (list, tuple, np.ndarray)) and all(isinstance(value, Real) for value in data):
        return tuple(f"{topic}[{j}]" for j in range(len(data))), [float(value) for value in data], True
    raise DataError(
        f"topic {topic!r} holds {kind}, expected joint states (name, position, velocity, effort) or numbers (Float64MultiArray, "
        "Float64): write it to an NPZ or CSV."
    )


def _joints(message: Any, topic: str) -> tuple[tuple[str, ...], list[float]]:
    """Signals of a joint state."""
    joints, names, values = list(message.name), [], []
    if len(set(joints)) < len(joints):
        raise DataError(
            f"topic {topic!r}: a message lists a joint twice, {joints}; give every joint a name of its own."
        )
    for key, ending in FIELDS.items():
        read = getattr(message, key, None)
        if read is None or not len(read):
            continue
        if len(read) != len(joints):
            raise DataError(
                f"topic {topic!r}: a message has {len(joints)} names, {joints}, and {len(read)} values of {key}; expected one for each "
                "joint, or none."
            )
        names += [joint + ending for joint in joints]
        values += [np.nan if value is None else float(value) for value in read]
    return tuple(names), values


def _check_widths(found: Any) -> None:
    """Arrays without names have one length."""
    widths: dict[str, int] = {}
    for messages in found:
        if messages.numbered and widths.setdefault(messages.topic, len(messages.names)) != len(messages.names):
            raise DataError(
                f"topic {messages.topic!r}: arrays of {widths[messages.topic]} and of {len(messages.names)} numbers; without names, "
                "expected one length."
            )


def _stamp(message: Any) -> int | None:
    """Stamp in the header in ns; ROS 2 calls its parts sec and nanosec, ROS 1 secs and nsecs."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    whole = getattr(stamp, "sec", getattr(stamp, "secs", 0))
    part = getattr(stamp, "nanosec", getattr(stamp, "nsecs", getattr(stamp, "nsec", 0)))
    return int(whole) * 10**9 + int(part)


# ---- time -------------------------------------------------------------------------------------------------------------
def _clock(found: Sequence[_Messages], clock: str) -> tuple[str, list[str]]:
    """One clock for all messages: headers where all have a stamp, else the times of recording."""
    _forget_zeros(found)
    without = sorted({messages.topic for messages in found if None in messages.stamped})
    if clock != "auto":
        return clock, []
    if not without:
        return "header", []
    some = any(stamp is not None for messages in found for stamp in messages.stamped)
    note = f"Messages of {shown(without)} have no stamp in a header: the times of recording count for all topics."
    return "log", [note] if some else []


def _forget_zeros(found: Sequence[_Messages]) -> None:
    """A stamp of 0 is none, unless others are of a simulated clock, which begins there."""
    given = [stamp for messages in found for stamp in messages.stamped if stamp]
    if not given or min(given) > SIMULATED:
        for messages in found:
            messages.stamped = [stamp or None for stamp in messages.stamped]


def _times(messages: _Messages, clock: str) -> list[int]:
    """Times of messages in ns."""
    if clock == "log":
        return messages.logged
    return [logged if stamp is None else stamp for stamp, logged in zip(messages.stamped, messages.logged)]


def _stream(messages: _Messages, clock: str, origin: int, reading: bool, notes: list[str]) -> Stream:
    """Messages in the order of time; a reading that is sent twice counts once."""
    ns = np.array([time - origin for time in _times(messages, clock)], dtype=np.int64)
    values = np.array(messages.values, dtype=float).reshape(len(ns), len(messages.names))
    back = int(np.sum(np.diff(ns) < 0))
    if back:
        notes.append(f"Sorted, messages of {messages.topic} that came out of order: {back}.")
    order = np.argsort(ns, kind="stable")
    ns, values = ns[order], values[order]
    if reading:
        again = np.append(False, np.diff(ns) == 0)
        differs = again[1:] & ~np.all(
            (values[1:] == values[:-1]) | np.isnan(values[1:]) | np.isnan(values[:-1]), axis=1
        )
        if differs.any():
            k = int(np.argmax(differs))
            j = int(np.flatnonzero(values[k + 1] != values[k])[0])
            other = "log" if clock != "log" else "header"
            raise DataError(
                f"topic {messages.topic!r}: two readings of {messages.names[j]!r} at the same time, {ns[k] / 1e9:.9g} s from the first: "
                f"{values[k, j]:g} and {values[k + 1, j]:g}. Take the other clock, clock={other!r}, or delete one."
            )
        ns, values = ns[~again], values[~again]
    return Stream(messages.topic, messages.names, ns / 1e9, values, messages.numbered)


def _with_numbers(stream: Stream) -> Stream:
    """A stream without the messages that lack all of its signals."""
    some = ~np.isnan(stream.values).all(axis=1)
    return replace(stream, t=stream.t[some], values=stream.values[some])
