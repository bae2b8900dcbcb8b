"""How fast a large log's /nav/state is read: fss against mcap-ros2-support and rosbags, each in a process of its own.

    python read_log.py LOG.mcap     an existing log
    python read_log.py --make 1000 LOG.mcap   flies one of about so many MB first

One field of all samples is kept, then whole samples, by each: memory compares like with like. Whole samples as Python's objects
take gigabytes of a log of one.
"""

import resource
import subprocess
import sys
import time
from pathlib import Path

TOPIC = "/nav/state"


def with_fss(path, whole):
    import fss

    nav = fss.Log(path)[TOPIC] if whole else fss.Log(path).read([TOPIC], fields=["x_m"])[TOPIC]
    return len(nav), float(nav["x_m"].sum())


def with_mcap_ros2(path, whole):
    from mcap_ros2.reader import read_ros2_messages

    return kept((message.ros_msg for message in read_ros2_messages(path, topics=[TOPIC])), whole)


def with_rosbags(path, whole):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([Path(path)], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        connections = [c for c in reader.connections if c.topic == TOPIC]
        return kept((reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)), whole)


def kept(messages, whole):
    if whole:
        messages = list(messages)
    x_m = [message.x_m for message in messages]
    return len(x_m), sum(x_m)


#: Size of a log for each second of flight, MB.
MB_A_SECOND = 0.11

HEAD = """name = "long-hold"
description = "The base holds its pose for long."
"""
#: A phase lasts an hour at most.
HOUR = """[[phase]]
name = "hold-{number}"
duration_s = 3600
base = {{ goal = "hold" }}
arm = {{ goal = "hold" }}
"""


def make(path, megabytes):
    """Flies for as long as it takes to fill so much."""
    import fss

    mission = Path(path).with_suffix(".toml")
    hours = -(-megabytes // (3600 * MB_A_SECOND))
    mission.write_text(HEAD + "".join(HOUR.format(number=hour) for hour in range(int(hours))))
    fss.fly(mission, out=Path(path).parent / "flight", progress=False).path.rename(path)


READERS = {"fss": with_fss, "mcap-ros2-support": with_mcap_ros2, "rosbags": with_rosbags}

def measure(path, whole):
    """Each reader in a process of its own: seconds, and its largest memory."""
    results = {}
    print("whole samples" if whole else "one field")
    for name in READERS:
        command = [sys.executable, __file__, name, "whole" if whole else "field", path]
        took_s, peak_mb, count, total = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        results[name] = (float(took_s), float(peak_mb))
        print(f"  {name:20}{float(took_s):8.2f} s {float(peak_mb):8.0f} MB   {count} samples, sum {total}")
    for name in list(READERS)[1:]:
        faster, smaller = (other / own for other, own in zip(results[name], results["fss"]))
        print(f"  fss is {faster:.1f} times as fast as {name}, with 1/{smaller:.1f} of its memory")


if __name__ == "__main__":
    if sys.argv[1] in READERS:
        begin = time.perf_counter()
        count, total = READERS[sys.argv[1]](sys.argv[3], sys.argv[2] == "whole")
        took_s = time.perf_counter() - begin
        print(f"{took_s} {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024} {count} {total!r}")
    elif sys.argv[1] == "make":
        make(sys.argv[3], float(sys.argv[2]))
    else:
        if sys.argv[1] == "--make":
            # Not here: what a process had in memory counts for those that it starts.
            subprocess.run([sys.executable, __file__, "make", sys.argv[2], sys.argv[3]], check=True)
        measure(sys.argv[-1], whole=False)
        measure(sys.argv[-1], whole=True)
