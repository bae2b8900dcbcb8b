"""The far end of `fss bench ipc` in Python: sends back what comes, in a loop of its own, on fss.service."""

import sys

from fss.service import INFO, Joined, Service

from fss_messages import NavState

PATIENCE_NS = 1_000_000_000
LAST = 2**64 - 1


class Echo(Service):
    name = "echo"
    inputs = {"ping": ("/ping", NavState)}
    outputs = {"pong": ("/pong", NavState)}


with Joined(Echo, sys.argv[1]) as stack:
    stack.outputs.event(INFO, "sends back what comes")
    heard_ns = stack.take()
    print("ready", flush=True)
    while True:
        now_ns = stack.take()
        sample = stack.inputs.ping.fresh()
        if sample is None:
            if now_ns - heard_ns > PATIENCE_NS:
                break
            continue
        if sample.stamp_ns == LAST:
            break
        stack.outputs.pong.publish(sample)
        heard_ns = now_ns
