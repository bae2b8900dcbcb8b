"""What a client of rmw_zenoh's sees of a flight: every topic with its type, hashes as rosidl has them, samples equal to the log's.
And what it may want: goals that it publishes are flown where the launch file names their topics, and nowhere else.

usage: read_ros2.py FSS, with PyPI's zenoh-ros2-sdk, rosbags, mcap-ros2-support and rosidl (ros-jazzy-rosidl-adapter,
ros-jazzy-rosidl-generator-type-description) installed; with ROS 2's own serialization where rclpy can be imported.
"""

import contextlib
import io
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

import zenoh
from numpy import array
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash
from zenoh_ros2_sdk import ROS2Publisher, get_topic_names_and_types

ROOT = pathlib.Path(__file__).parent.parent
PORT = 54900
FLOWN = ["/nav/state", "/links/state", "/mission/state", "/mocap/base", "/gyro", "/thrusters/state", "/health", "/truth/state"]
OTHERS = ["/mocap/end_effector", "/mocap/target", "/links/telemetry", "/arm/command", "/base/command", "/thrusters/command",
          "/calibration/posture", "/mission/command", "/mission/goal", "/parameters/command", "/parameters/state", "/events", "/steps", "/peer"]
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


def launch(shared, more=""):
    """The laboratory's launch file with nodes that see these topics."""
    text = (ROOT / "deploy/etc/launch/lab.toml").read_text().replace("51001", "54910").replace("5110", "5492")
    head = f'[ros2]\nlisten = ["127.0.0.1:{PORT}"]\nshare = {shared}\n{more}\n'.replace("'", '"')
    table = '\n[[service]]\nname = "bridge"\nrate_hz = 50\nphase_us = 4500\n'
    place = text.index("[devices]")
    return text[:place] + head + text[place:] + table


def ros2_itself():
    """By type, how ROS 2 itself reads and writes messages: a function that gives the bytes again; none where rclpy is not there."""
    os.environ["RMW_IMPLEMENTATION"] = "rmw_fastrtps_cpp"
    try:
        from diagnostic_msgs.msg import DiagnosticArray
        from nav_msgs.msg import Odometry
        from rclpy.serialization import deserialize_message, serialize_message
        from sensor_msgs.msg import JointState
    except ImportError as why:
        print(f"skipped: ROS 2's own serialization: {why}")
        return {}
    again = lambda kind: lambda payload: serialize_message(deserialize_message(payload, kind))
    kinds = {"diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray, "nav_msgs/msg/Odometry": Odometry, "sensor_msgs/msg/JointState": JointState}
    return {name: again(kind) for name, kind in kinds.items()}


def main(fss):
    own = ros2_itself()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "launch.toml").write_text(launch(SHARED))
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
    counts, read_by_ros2 = {}, 0
    for key, payload, attachment in heard:
        _, *name, dds, rihs = key.split("/")
        name = "/" + "/".join(name)
        package, kind = dds.split("::msg::dds_::")
        kind = f"{package}/msg/{kind.rstrip('_')}"
        assert topics[name] == [kind], f"{name}: {topics[name]}, {kind}"
        assert STANDARD.get(name, kind) == kind
        assert store.hash_rihs01(kind) == rihs, f"{kind}: {rihs}"
        store.deserialize_cdr(payload, kind)
        if kind in own:
            # ROS 2 leaves in the gaps between fields what was there before.
            written = store.serialize_cdr(store.deserialize_cdr(own[kind](payload), kind), kind)
            assert bytes(written) == payload, f"ROS 2 writes this {kind} otherwise"
            read_by_ros2 += 1
        assert len(attachment) == 33 and attachment[16] == 16
        counts[name] = counts.get(name, 0) + 1
        if name in logged:
            assert payload in logged[name], f"a sample of {name} is not in the log"
    for name in FLOWN + list(STANDARD):
        assert counts.get(name, 0) > 0, f"nothing came on {name}"
    print(f"rosidl: the hashes of {len(official)} messages are equal")
    print(f"rmw_zenoh: {len(counts)} topics with their types, {sum(counts.values())} samples decoded: {counts}")

    if own:
        print(f"rclpy: {read_by_ros2} messages of {len(own)} types are read, and written again with the same fields")


RECEIVE = """
[[ros2.receive]]
topic = '/goal_pose'
type = 'geometry_msgs/msg/PoseStamped'
max_rate_hz = 10
x_m = [-1, 1]
y_m = [-1, 1]
[[ros2.receive]]
topic = '/joint_commands'
type = 'sensor_msgs/msg/JointState'
max_rate_hz = 100
q_deg = [-70, 70]
"""


def lead(fss):
    """Goals of zenoh-ros2-sdk are flown on the topics that the list names; on another they are counted."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {name.rsplit("/", 1)[1]: kind for name, kind in store.types.items() if "geometry_msgs" in name or "std_msgs" in name}

    def publisher(topic, kind):
        definition, _ = store.generate_msgdef(kind)
        return ROS2Publisher(topic, kind, definition, type_hash=store.hash_rihs01(kind), router_port=PORT)

    now = store.types["builtin_interfaces/msg/Time"](0, 0)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "launch.toml").write_text(launch(["/nav/state"], RECEIVE))
        (folder / "led.toml").write_text((ROOT / "deploy/etc/missions/follow.toml").read_text().replace("= 600", "= 24"))
        run = subprocess.Popen([fss, "run", folder / "led.toml", "--quiet", "--launch", folder / "launch.toml", "--out", folder / "out"])
        time.sleep(6)
        q = [-0.45, 0.95, -1.0, 0.6]
        pose = types["Pose"](types["Point"](-0.55, 0.03, 0.0), types["Quaternion"](0.0, 0.0, math.sin(0.05), math.cos(0.05)))
        goals = {topic: publisher(topic, "geometry_msgs/msg/PoseStamped") for topic in ["/goal_pose", "/other/goal"]}
        joints = publisher("/joint_commands", "sensor_msgs/msg/JointState")
        time.sleep(1)
        for goal in goals.values():
            goal.publish(header=types["Header"](now, "map"), pose=pose)
        for _ in range(50):
            names = [f"joint_{i}" for i in range(1, 5)]
            joints.publish(header=types["Header"](now, ""), name=names, position=array(q), velocity=array([]), effort=array([]))
            time.sleep(0.05)
        assert run.wait() == 0
        last = {}
        with open(folder / "out/run.mcap", "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, _, message in reader.iter_decoded_messages(topics=["/nav/state", "/links/state", "/ros2/peer"]):
                last[channel.topic] = message
    nav, links, peer = last["/nav/state"], last["/links/state"], last["/ros2/peer"]
    apart = math.hypot(nav.x_m + 0.55, nav.y_m - 0.03)
    joint = max(abs(is_ - wanted) for is_, wanted in zip(links.q_rad, q))
    assert apart < 0.02 and joint < 0.01, f"{apart} m and {joint} rad away"
    assert (peer.received, peer.refused_topic) == (51, 1), peer
    print(f"zenoh-ros2-sdk: its goals are flown, {apart * 1e3:.1f} mm and {joint * 1e3:.1f} mrad away at the end; one on another topic is counted")


main(sys.argv[1])
lead(sys.argv[1])
