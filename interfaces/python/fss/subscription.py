"""A running stack's topics, read in shared memory while it flies."""

from __future__ import annotations

import ctypes
import importlib
import time
from collections.abc import Iterator
from typing import Any, Optional

import numpy as np

from . import _fss
from .samples import Samples, samples_of


class Subscription:
    """A topic of a stack that runs on this computer: see :func:`live`."""

    def __init__(self, topic: str, bus: str, vehicle: str, buffer: int) -> None:
        # It tells no types.
        iox: Any = importlib.import_module("iceoryx2")
        known = {name: (type_name, size, fields) for name, type_name, size, fields in _fss.live_topics(bus)}
        if topic not in known:
            raise KeyError(f"the stack has no topic '{topic}'; it has {', '.join(known)}")
        type_name, self._size, self._fields = known[topic]
        self.topic = topic
        payload = type(
            "Sample",
            (ctypes.Structure,),
            {"_fields_": [("words", ctypes.c_uint64 * (self._size // 8))], "type_name": staticmethod(lambda: type_name)},
        )
        iox.set_log_level(iox.LogLevel.Fatal)
        config = iox.config.default()
        config.global_cfg.prefix = iox.FileName.new(bus)
        builder = iox.NodeBuilder.new().name(iox.NodeName.new("python")).config(config)
        self._node: Any = builder.signal_handling_mode(iox.SignalHandlingMode.Disabled).create(iox.ServiceType.Ipc)
        name = f"/{vehicle}{topic}" if vehicle else topic
        service = self._node.service_builder(iox.ServiceName.new(name)).publish_subscribe(payload).open()
        self._subscriber: Any = service.subscriber_builder().buffer_size(buffer).create()
        self._start_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC)

    def take(self) -> Samples:
        """All samples since the last time; ``t_s`` counts from the begin of the subscription. Raises ValueError when closed."""
        if self._subscriber is None:
            raise ValueError(f"the subscription of {self.topic} is closed")
        taken = []
        while (sample := self._subscriber.receive()) is not None:
            taken.append(ctypes.string_at(ctypes.addressof(sample.payload().contents), self._size))
            sample.delete()
        data = np.frombuffer(b"".join(taken), dtype=np.uint8)
        return samples_of(self._fields, self._size, data, self.topic, self._start_ns)

    def stream(self, period_s: float = 0.05, duration_s: float = float("inf")) -> Iterator[Samples]:
        """What came in each period, where anything came, for so long."""
        end = time.monotonic() + duration_s
        while time.monotonic() < end:
            time.sleep(period_s)
            samples = self.take()
            if len(samples) > 0:
                yield samples

    def close(self) -> None:
        """Leaves the stack."""
        self._subscriber = self._node = None

    def __enter__(self) -> Subscription:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def live(topic: str, *, bus: Optional[str] = None, vehicle: str = "", buffer: int = 128) -> Subscription:
    """Subscribes to a topic of a stack that runs on this computer. Flight processes do not wait for it.

    ``bus`` is the stack's prefix in shared memory, needed where several run; ``vehicle`` its vehicle's name, where it has one;
    ``buffer``: how many samples wait between two calls of ``take`` before the oldest is lost (256 at most). Needs the package
    iceoryx2, version 0.10.

    Raises KeyError for an unknown topic, fss.Error where no stack or more than one runs.
    """
    return Subscription(topic, bus if bus is not None else _fss.running_stack(), vehicle, buffer)
