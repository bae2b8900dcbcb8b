"""Reads a log of ours with other people's tools and compares every field with what our own reader exported.

    python read_log.py RUN.mcap EXPORT_DIR [TOPIC...]       # EXPORT_DIR from `fss log export`

Exits with 1 where a tool cannot read the log, does not find one of the topics, or where one value differs.
"""

import csv
import math
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def columns(message, names):
    """The message as the export's columns: arrays are spread as name.0, name.1 and so on."""
    row = []
    for name in names:
        field, _, index = name.partition(".")
        value = getattr(message, field)
        row.append(value[int(index)] if index else value)
    return row


def exported(folder, topic):
    """Column names and rows that our own reader found."""
    with open(folder / (topic.strip("/").replace("/", ".") + ".csv"), newline="") as file:
        rows = csv.reader(file)
        return next(rows), list(rows)


def same(ours, theirs):
    """Whether a value that we printed is the value that they decoded, to the last bit; text is an array of bytes to them."""
    if hasattr(theirs, "__len__"):
        return ours == bytes(theirs).split(b"\0")[0].decode()
    if isinstance(theirs, float):
        return float(ours) == theirs or (math.isnan(float(ours)) and math.isnan(theirs))
    return int(ours) == int(theirs)


def look_for(tool, topics, found):
    """Whether the tool found these topics."""
    missing = [topic for topic in topics if topic not in found]
    if missing:
        sys.exit(f"{tool}: does not find {', '.join(missing)}")


def compare(tool, topic, messages, folder):
    names, rows = exported(folder, topic)
    # Tools differ in how they order what several publishers sent at nearly one time.
    keys = ("published_ns", "sequence", "stamp_ns")
    rows.sort(key=lambda row: [int(row[names.index(key)]) for key in keys])
    messages.sort(key=lambda message: [getattr(message, key) for key in keys])
    if len(rows) != len(messages):
        sys.exit(f"{tool}: {topic}: {len(messages)} messages, ours has {len(rows)}")
    for i, (message, row) in enumerate(zip(messages, rows)):
        for name, ours, theirs in zip(names, row, columns(message, names)):
            if not same(ours, theirs):
                sys.exit(f"{tool}: {topic}: message {i}, {name}: {theirs}, ours {ours}")
    return len(rows) * len(names)


def main():
    log, folder, topics = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
    by_topic = {}
    with open(log, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(log_time_order=False):
            by_topic.setdefault(channel.topic, []).append(message)
    look_for("mcap-ros2-support", topics, by_topic)
    values = sum(compare("mcap-ros2-support", t, m, folder) for t, m in by_topic.items())
    print(f"mcap-ros2-support: {len(by_topic)} topics, {values} values equal")

    by_topic = {}
    with AnyReader([log], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        for connection, _, raw in reader.messages():
            by_topic.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    look_for("rosbags", topics, by_topic)
    values = sum(compare("rosbags", t, m, folder) for t, m in by_topic.items())
    print(f"rosbags: {len(by_topic)} topics, {values} values equal")


main()
