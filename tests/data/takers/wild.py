"""`wild`: writes garbage into its sample, says far too much, and writes more words of errors than a pipe holds."""

import ctypes
import random
import sys

from fss.service import Service, main

import fss_messages
from wild_messages import WildState


class Wild(Service):
    name = "wild"
    inputs = {"nav": fss_messages.NAV_STATE}
    outputs = {"state": ("/wild/state", WildState)}
    config = ("smoothing_s",)

    def __init__(self, config, rate_hz):
        self.random = random.Random(1)

    def step(self, now_ns, inputs, outputs):
        state = WildState()
        ctypes.memmove(ctypes.addressof(state), self.random.randbytes(ctypes.sizeof(state)), ctypes.sizeof(state))
        outputs.state.publish(state)
        for _ in range(200):
            outputs.event(255, "wild \x07" * 100)
        sys.stderr.write("wild words\n" * 1000)


if __name__ == "__main__":
    main(Wild)
