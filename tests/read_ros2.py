"""What a client of rmw_zenoh's sees of a flight: every topic with its type, hashes as rosidl has them, samples equal to the log's.

usage: read_ros2.py FSS, with PyPI's zenoh-ros2-sdk, rosbags, mcap-ros2-support and rosidl (ros-jazzy-rosidl-adapter,
ros-jazzy-rosidl-generator-type-description) installed.
"""

import contextlib
import io
import json
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

import zenoh
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash
from zenoh_ros2_sdk import get_topic_names_and_types

PORT = 54900
FLOWN = ["/nav/state", "/links/state", "/mission/state", "/mocap/base", "/gyro", "/thrusters/state", "/health", "/truth/state"]
OTHERS = ["/mocap/end_effector", "/mocap/target", "/links/telemetry", "/arm/command", "/base/command", "/thrusters/command",
          "/calibration/posture", "/mission/command", "/parameters/command", "/parameters/state", "/events", "/steps", "/peer"]
SHARED = FLOWN + OTHERS
STANDARD = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/odom": "nav_msgs/msg/Odometry",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


def official_hashes(package):
    """By type, RIHS01 as rosidl computes it from the package's .msg files."""
    with tempfile.TemporaryDirectory() as out, contextlib.redirect_stdout(io.StringIO()):
        out, tuples = pathlib.Path(out), []
        for path in package.glob("msg/*.msg"):
            convert_msg_to_idl(package.absolute(), package.name, path.relative_to(package), out / "msg")
            tuples.append(f"{out}:msg/{path.stem}.idl")
        arguments = {"package_name": package.name, "output_dir": str(out), "idl_tuples": tuples, "include_paths": []}
        (out / "arguments.json").write_text(json.dumps(arguments))
        generate_type_hash(str(out / "arguments.json"))
        hashes = [each for path in out.glob("msg/*.json") for each in json.loads(path.read_text())["type_hashes"]]
        return {each["type_name"]: each["hash_string"] for each in hashes}


def main(fss):
    root = pathlib.Path(__file__).parent.parent
    text = (root / "deploy/etc/launch/lab.toml").read_text().replace("51001", "54910").replace("5110", "5492")
    head = f'[ros2]\nlisten = ["127.0.0.1:{PORT}"]\nshare = {SHARED}\n\n'.replace("'", '"')
    table = '\n[[service]]\nname = "bridge"\nrate_hz = 50\nphase_us = 4500\n'
    place = text.index("[devices]")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "launch.toml").write_text(text[:place] + head + text[place:] + table)
        subprocess.run([fss, "messages", "--ros2", folder / "src"], check=True, capture_output=True)
        run = subprocess.Popen([fss, "run", "zero-reaction", "--quiet", "--launch", folder / "launch.toml", "--out", folder / "out"])
        time.sleep(4)
        topics = dict(get_topic_names_and_types(domain_id=0, router_ip="127.0.0.1", router_port=PORT, timeout=3))
        for name in SHARED + list(STANDARD):
            assert name in topics, f"{name} is not seen, only {sorted(topics)}"
        config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["tcp/127.0.0.1:{PORT}"]}}}}')
        heard, lock = [], threading.Lock()

        def take(sample):
            with lock:
                heard.append((str(sample.key_expr), bytes(sample.payload), bytes(sample.attachment)))

        session = zenoh.open(config)
        tokens = [str(reply.ok.key_expr).split("/") for reply in session.liveliness().get("@ros2_lv/0/**") if reply.ok]
        told = {t[10].replace("::msg::dds_::", "/msg/").rstrip("_"): t[11] for t in tokens if t[5] == "MP"}
        official = official_hashes(folder / "src/fss_msgs")
        for name, rihs in official.items():
            assert told[name] == rihs, f"{name}: {told[name]}, rosidl has {rihs}"
        subscriber = session.declare_subscriber("0/**", take)
        assert run.wait() == 0
        subscriber.undeclare()
        session.close()

        store = get_typestore(Stores.ROS2_JAZZY)
        types = {}
        for path in (folder / "src").glob("*/msg/*.msg"):
            types.update(get_types_from_msg(path.read_text(), f"{path.parent.parent.name}/msg/{path.stem}"))
        store.register(types)
        logged = {name: set() for name in SHARED}
        with open(folder / "out/run.mcap", "rb") as file:
            for _, channel, message in make_reader(file).iter_messages(topics=SHARED):
                logged[channel.topic].add(message.data)
    counts = {}
    for key, payload, attachment in heard:
        _, *name, dds, rihs = key.split("/")
        name = "/" + "/".join(name)
        package, kind = dds.split("::msg::dds_::")
        kind = f"{package}/msg/{kind.rstrip('_')}"
        assert topics[name] == [kind], f"{name}: {topics[name]}, {kind}"
        assert STANDARD.get(name, kind) == kind
        assert store.hash_rihs01(kind) == rihs, f"{kind}: {rihs}"
        store.deserialize_cdr(payload, kind)
        assert len(attachment) == 33 and attachment[16] == 16
        counts[name] = counts.get(name, 0) + 1
        if name in logged:
            assert payload in logged[name], f"a sample of {name} is not in the log"
    for name in FLOWN + list(STANDARD):
        assert counts.get(name, 0) > 0, f"nothing came on {name}"
    print(f"rosidl: the hashes of {len(official)} messages are equal")
    print(f"rmw_zenoh: {len(counts)} topics with their types, {sum(counts.values())} samples decoded: {counts}")


main(sys.argv[1])
