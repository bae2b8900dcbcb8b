"""What other people's clients read of the simulated laboratory's motion capture, against what navigation was given.

usage: read_mocap.py FSS KIND, KIND being natnet or vrpn, with PyPI's natnet and motioncapture installed. Flies `hold` for some
seconds with that tracker, reads it with the client, and compares each pose with the log's /mocap/base of the same frame.
"""

import math
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

from mcap_ros2.reader import read_ros2_messages

HOST, PORT = "127.0.0.1", 54800
MISSION = """name = "short"
description = "Holds."
[[phase]]
name = "hold"
duration_s = 8
base = { goal = "hold" }
arm = { goal = "hold" }
"""


def natnet_poses(until):
    """By frame number: x, y, heading as the client of PyPI's natnet gives them."""
    from natnet import DataFrame, NatNetClient

    seen = {}

    def take(frame: DataFrame):
        for body in frame.rigid_bodies:
            if body.id_num == 1 and body.tracking_valid:
                x, y, z, w = body.rot
                seen[frame.prefix.frame_number] = (body.pos[0], body.pos[1], 2 * math.atan2(z, w))

    client = NatNetClient(server_ip_address=HOST, local_ip_address=HOST, command_port=PORT, use_multicast=False)
    with client:
        client.on_data_frame_received_event.handlers.append(take)
        while time.monotonic() < until:
            client.update_sync()
            time.sleep(0.002)
    return seen


def vrpn_poses(until):
    """In the order in which they came: x, y, heading as libvrpn gives them to PyPI's motioncapture."""
    import motioncapture

    client = motioncapture.connect("vrpn", {"hostname": f"{HOST}:{PORT}"})
    seen = []
    while time.monotonic() < until:
        client.waitForNextFrame()
        body = client.rigidBodies.get("base")
        if body is not None:
            q = body.rotation
            seen.append((body.position[0], body.position[1], 2 * math.atan2(q.z, q.w)))
    return seen


def apart(one, other):
    turn = one[2] - other[2]
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]), abs(math.remainder(turn, 2 * math.pi)))


def main(fss, kind):
    launch = pathlib.Path(__file__).parent.parent / "deploy/etc/launch/lab.toml"
    text = launch.read_text().replace('kind = "vicon", listen', f'kind = "{kind}", server')
    text = text.replace("51001", str(PORT)).replace("5110", "5485")
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "launch.toml").write_text(text)
        (folder / "short.toml").write_text(MISSION)
        run = subprocess.Popen([fss, "run", "--quiet", folder / "short.toml", "--launch", folder / "launch.toml", "--out", folder / "out"])
        time.sleep(3)
        poses = {"natnet": natnet_poses, "vrpn": vrpn_poses}[kind](time.monotonic() + 4)
        assert run.wait() == 0
        log = [m.ros_msg for m in read_ros2_messages(folder / "out/run.mcap", topics=["/mocap/base"])]
    given = [(m.x_m, m.y_m, m.theta_rad) for m in log]
    if kind == "natnet":
        by_frame = dict(zip((m.frame for m in log), given))
        worst = max(apart(pose, by_frame[frame]) for frame, pose in poses.items() if frame in by_frame)
    else:
        worst = max(min(apart(pose, other) for other in given) for pose in poses)
    assert len(poses) > 100, f"{len(poses)} poses"
    assert worst < 1e-6, f"{worst}"
    print(f"{kind}: {len(poses)} poses as navigation was given them, within {worst:.1e} m and rad")


main(sys.argv[1], sys.argv[2])
