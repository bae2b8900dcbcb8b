"""`taker`: how many samples of navigation each step takes, where its config says what the test has written there."""

from fss.service import Refused, Service, main

import fss_messages
from taker_messages import TakerState


class Taker(Service):
    name = "taker"
    inputs = {"nav": fss_messages.NAV_STATE}
    outputs = {"state": ("/taker/state", TakerState)}
    every = ("nav",)
    options = ("frame", "gains")

    def __init__(self, config, rate_hz):
        if config["frame"] != "table" or config["gains"] != {"kp": [1, 2.5]}:
            raise Refused(f"config: {config} is not as it was written")
        self.sequence = 0

    def step(self, now_ns, inputs, outputs):
        samples = inputs.nav.samples()
        in_order = [sample.sequence for sample in samples] == [self.sequence + 1 + i for i in range(len(samples))]
        self.sequence += len(samples)
        outputs.state.publish(TakerState(stamp_ns=now_ns, speed_m_s=len(samples), valid=int(in_order)))


if __name__ == "__main__":
    main(Taker)
