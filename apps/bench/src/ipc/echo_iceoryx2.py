"""The far end of `fss bench ipc` in Python: sends back what comes, on iceoryx2's own package."""

import sys
import time

import iceoryx2 as iox2

from fss_messages import NavState

PATIENCE_S = 1.0
LAST = 2**64 - 1

iox2.set_log_level(iox2.LogLevel.Fatal)
config = iox2.config.default()
config.global_cfg.prefix = iox2.FileName.new(sys.argv[1])
node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
topic = lambda name: node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(NavState).open()
subscriber, publisher = topic("/ping").subscriber_builder().buffer_size(1).create(), topic("/pong").publisher_builder().create()
print("ready", flush=True)
heard = time.monotonic()
while True:
    sample = subscriber.receive()
    if sample is None:
        if time.monotonic() - heard > PATIENCE_S:
            break
        continue
    state = NavState.from_buffer_copy(sample.payload().contents)
    sample.delete()
    if state.stamp_ns == LAST:
        break
    publisher.loan_uninit().write_payload(state).send()
    heard = time.monotonic()
