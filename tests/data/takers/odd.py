"""`odd`: fails to start at first, freezes at its second start, and floods its topic with garbage ever after."""

import ctypes
import pathlib
import random
import time

from fss.service import Service, main

import fss_messages
from odd_messages import OddState


class Odd(Service):
    name = "odd"
    inputs = {"nav": fss_messages.NAV_STATE}
    outputs = {"state": ("/odd/state", OddState)}
    config = ("smoothing_s",)

    def __init__(self, config, rate_hz):
        starts = pathlib.Path(__file__).with_name("starts")
        self.starts = int(starts.read_text() if starts.exists() else 0) + 1
        starts.write_text(str(self.starts))
        if self.starts == 1:
            raise ValueError("no luck at first")
        self.random, self.steps = random.Random(1), 0

    def step(self, now_ns, inputs, outputs):
        self.steps += 1
        while self.starts == 2 and self.steps == 40:
            time.sleep(60)
        state = OddState(stamp_ns=now_ns)
        for _ in range(64):
            if self.starts > 2:
                garbage = self.random.randbytes(ctypes.sizeof(state) - 8) + b"\xff" * 8
                ctypes.memmove(ctypes.addressof(state), garbage, len(garbage))
                state.speed_m_s = float("nan")
                outputs.event(255, "odd \x07" * 100)
            outputs.state.publish(state)


if __name__ == "__main__":
    main(Odd)
