"""A service of a floating spacecraft simulator, written in Python."""

import ctypes
from types import SimpleNamespace
from typing import Any, Generic, NoReturn, Optional, TypeVar

DEBUG: int
INFO: int
WARNING: int
ERROR: int
CRITICAL: int

M = TypeVar("M", bound=ctypes.Structure)

class Latest(Generic[M]):
    def get(self) -> Optional[M]: ...
    def fresh(self) -> Optional[M]: ...
    def within(self, now_ns: int, max_age_ns: int) -> Optional[M]: ...

class Output(Generic[M]):
    def publish(self, sample: M) -> None: ...

class Refused(Exception): ...

class Service:
    name: str
    inputs: dict[str, tuple[str, type[Any]]]
    outputs: dict[str, tuple[str, type[Any]]]
    config: tuple[str, ...]
    def __init__(self, config: dict[str, float], rate_hz: float) -> None: ...
    def step(self, now_ns: int, inputs: SimpleNamespace, outputs: SimpleNamespace) -> None: ...

def main(service: type[Service]) -> NoReturn: ...
