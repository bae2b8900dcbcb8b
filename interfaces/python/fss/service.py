"""A service of a floating spacecraft simulator, written in Python.

A service is a class with a name, topics that it reads and writes, and a pure step; `main` makes it the program that a launcher
starts, watches and restarts, records and replays as it does fss's own services. The step reads no clock and opens nothing: then
it flies on any clock, and gives the same bits again from a log.

Messages are ctypes structures: `fss messages --python` prints fss's own, `fss messages --python FILE.msg` one's own.
"""

import ctypes
import json
import os
import sys
import traceback
from types import SimpleNamespace

DEBUG, INFO, WARNING, ERROR, CRITICAL = range(5)


class _Topic(ctypes.Structure):
    _fields_ = [
        ("topic", ctypes.c_char_p),
        ("schema", ctypes.c_char_p),
        ("definition", ctypes.c_char_p),
        ("size", ctypes.c_size_t),
    ]


_Create = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.POINTER(ctypes.c_double), ctypes.c_double)
_Step = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint64)
_Destroy = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


class _Service(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("inputs", ctypes.POINTER(_Topic)),
        ("input_count", ctypes.c_size_t),
        ("outputs", ctypes.POINTER(_Topic)),
        ("output_count", ctypes.c_size_t),
        ("keys", ctypes.POINTER(ctypes.c_char_p)),
        ("key_count", ctypes.c_size_t),
        ("create", _Create),
        ("step", _Step),
        ("destroy", _Destroy),
        ("every", ctypes.POINTER(ctypes.c_size_t)),
        ("every_count", ctypes.c_size_t),
        ("options", ctypes.POINTER(ctypes.c_char_p)),
        ("option_count", ctypes.c_size_t),
    ]


def _load():
    # A wheel brings the library along, beside this file.
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "libfss.so")
    library = ctypes.CDLL(os.environ.get("FSS_LIBRARY", beside if os.path.exists(beside) else "libfss.so"))
    pointer, size = ctypes.c_void_p, ctypes.c_size_t
    library.fss_main.argtypes = [ctypes.c_int, ctypes.POINTER(ctypes.c_char_p), ctypes.POINTER(_Service)]
    library.fss_refuse.argtypes = [pointer, ctypes.c_char_p]
    library.fss_latest.argtypes, library.fss_latest.restype = [pointer, size], pointer
    library.fss_fresh.argtypes, library.fss_fresh.restype = [pointer, size], pointer
    library.fss_count.argtypes, library.fss_count.restype = [pointer, size], size
    library.fss_sample.argtypes, library.fss_sample.restype = [pointer, size, size], pointer
    library.fss_options.argtypes, library.fss_options.restype = [pointer], ctypes.c_char_p
    library.fss_publish.argtypes = [pointer, size, pointer]
    library.fss_event.argtypes = [pointer, ctypes.c_uint8, ctypes.c_char_p]
    library.fss_open.argtypes, library.fss_open.restype = [ctypes.POINTER(_Service), ctypes.c_char_p, ctypes.c_char_p], pointer
    library.fss_error.restype = ctypes.c_char_p
    library.fss_take.argtypes, library.fss_take.restype = [pointer], ctypes.c_uint64
    library.fss_close.argtypes = [pointer]
    return library


class Latest:
    """The newest sample of a topic; it stays until a newer one comes, so look at its age."""

    def __init__(self, library, place, message):
        self._library, self._place, self._message = library, place, message
        self._ports = None

    def _sample(self, address):
        return None if not address else self._message.from_buffer_copy(ctypes.string_at(address, ctypes.sizeof(self._message)))

    def get(self):
        """The newest sample, however old; None where there never was one."""
        return self._sample(self._library.fss_latest(self._ports, self._place))

    def fresh(self):
        """The newest sample if it came since the last step."""
        return self._sample(self._library.fss_fresh(self._ports, self._place))

    def samples(self):
        """The samples that came since the last step, oldest first: at most 64 where the service's `every` names the port, 1 where not."""
        count = self._library.fss_count(self._ports, self._place)
        return [self._sample(self._library.fss_sample(self._ports, self._place, i)) for i in range(count)]

    def within(self, now_ns, max_age_ns):
        """The newest sample if it is not older than max_age_ns by its stamp."""
        sample = self.get()
        return sample if sample is not None and now_ns - sample.stamp_ns <= max_age_ns else None


class Output:
    """Publishes to a topic. What a step publishes is sent when the step has ended."""

    def __init__(self, library, place, message):
        self._library, self._place, self._message = library, place, message
        self._ports = None

    def publish(self, sample):
        """Publishes a sample; sequence and published_ns are set for it, stamp_ns by the caller."""
        if not isinstance(sample, self._message):
            raise TypeError(f"this output takes {self._message.__name__}, not {type(sample).__name__}")
        if self._library.fss_publish(self._ports, self._place, ctypes.addressof(sample)) != 0:
            raise RuntimeError("it was not sent: a step publishes at most 64 samples of a topic")


class Refused(Exception):
    """Raised by a service's __init__: it cannot fly so, and why."""


class Service:
    """What a service has. A subclass sets these and defines step."""

    #: As in the launch file: up to 15 lower-case letters, digits and underscores.
    name = ""
    #: What it reads: for each port a topic, which is a pair of its name and its message.
    inputs = {}
    #: What it writes.
    outputs = {}
    #: The keys of its config in the launch file: all of them numbers, and all required.
    config = ()
    #: Further keys of its config: texts, tables and lists, none of them required.
    options = ()
    #: The input ports of which a step takes every sample; of the others it has the newest.
    every = ()

    def __init__(self, config, rate_hz):
        """Before the first step; config is a dictionary of what the launch file says."""

    def step(self, now_ns, inputs, outputs):
        """One step. inputs.PORT is a Latest, outputs.PORT an Output; outputs.event(severity, text) says that something happened."""
        raise NotImplementedError


class _Ports:
    """The ports of a service's class by their names."""

    def __init__(self, library, service):
        ports = lambda kind, topics: {port: kind(library, i, topic[1]) for i, (port, topic) in enumerate(topics.items())}
        inputs, outputs = ports(Latest, service.inputs), ports(Output, service.outputs)
        self._all, self._library, self._address = [*inputs.values(), *outputs.values()], library, None
        self.inputs, self.outputs = SimpleNamespace(**inputs), SimpleNamespace(**outputs, event=self._event)

    def _event(self, severity, text):
        self._library.fss_event(self._address, severity, text.encode())

    def at(self, address):
        """What the library calls them from now on."""
        self._address = address
        for port in self._all:
            port._ports = address


class _Bound:
    """A service's class with its ports, as the library calls them."""

    def __init__(self, library, service):
        self.library, self.service, self.running = library, service, None
        self.ports = _Ports(library, service)

    def create(self, ports, config, rate_hz):
        try:
            values = {key: config[i] for i, key in enumerate(self.service.config)}
            values.update(json.loads(self.library.fss_options(ports)))
            self.running = self.service(values, rate_hz)
        except Refused as reason:
            self.library.fss_refuse(ports, str(reason).encode())
        except Exception:
            self.library.fss_refuse(ports, traceback.format_exc().encode())
        return None

    def step(self, _itself, ports, now_ns):
        self.ports.at(ports)
        try:
            self.running.step(now_ns, self.ports.inputs, self.ports.outputs)
        except Exception:
            # What has failed is started anew by the launcher, as in any language.
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)


def _topics(topics):
    all_topics = (_Topic * len(topics))()
    for place, (name, message) in zip(all_topics, topics.values()):
        place.topic, place.schema = name.encode(), message.SCHEMA.encode()
        place.definition, place.size = message.DEFINITION.encode(), ctypes.sizeof(message)
    return all_topics


def _declared(service, create=_Create(), step=_Step()):
    """The service as the library takes it; it lives as long as what this gives."""
    inputs, outputs = _topics(service.inputs), _topics(service.outputs)
    texts = lambda keys: (ctypes.c_char_p * len(keys))(*[key.encode() for key in keys])
    keys, options = texts(service.config), texts(service.options)
    places = [list(service.inputs).index(port) for port in service.every]
    every = (ctypes.c_size_t * len(places))(*places)
    return _Service(
        service.name.encode(), inputs, len(inputs), outputs, len(outputs), keys, len(keys), create, step, _Destroy(),
        every, len(every), options, len(options),
    )


def main(service):
    """Runs the service as the launcher's command line says, and ends the program."""
    library = _load()
    bound = _Bound(library, service)
    create, step = _Create(bound.create), _Step(bound.step)
    declared = _declared(service, create, step)
    arguments = (ctypes.c_char_p * len(sys.argv))(*[argument.encode() for argument in sys.argv])
    sys.exit(library.fss_main(len(arguments), arguments, ctypes.byref(declared)))


class Joined(_Ports):
    """The ports of a service for a program with a loop of its own, which no launcher starts, watches or replays.

    It joins a stack that runs, by the stack's prefix in shared memory: "fss_N_" where N is the process number of `fss run`.
    Each `take` takes what has come, and what is published is sent at once::

        with Joined(Meter, "fss_1234_") as stack:
            now_ns = stack.take()
            nav = stack.inputs.nav.within(now_ns, 100_000_000)
    """

    def __init__(self, service, bus, vehicle=""):
        library = _load()
        super().__init__(library, service)
        address = library.fss_open(ctypes.byref(_declared(service)), bus.encode(), vehicle.encode())
        if not address:
            raise RuntimeError(library.fss_error().decode())
        self.at(address)

    def take(self):
        """Takes what has come since the last time; returns the time, ns."""
        return self._library.fss_take(self._address)

    def close(self):
        """Leaves the stack."""
        self._library.fss_close(self._address)
        self.at(None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
