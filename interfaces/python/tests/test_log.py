import csv
import pickle
import resource

import numpy as np
import pytest
from conftest import optional

import fss


def test_every_value_of_a_log_equals_the_exported_one(flight, program, tmp_path):
    program("log", "export", flight.path, "--out", tmp_path)
    for topic, samples in flight.read(list(flight)).items():
        with (tmp_path / (topic.strip("/").replace("/", ".") + ".csv")).open(newline="") as file:
            heading, *rows = csv.reader(file)
        columns = samples.columns()
        assert list(columns) == heading and len(samples) == len(rows)
        for name, exported in zip(heading, zip(*rows)):
            own = columns[name]
            if own.dtype == object:
                assert list(own) == list(exported), (topic, name)
            else:
                assert np.array_equal(own, np.array([own.dtype.type(text) for text in exported]), equal_nan=True), (topic, name)


def test_fields_are_looked_at_in_place(flight):
    nav = flight["/nav/state"]
    assert nav["x_m"].base is not None and np.shares_memory(nav["x_m"], nav)
    assert nav["std"].shape == (len(nav), 7) and "m" in nav.meanings["x_m"]


def test_chunks_are_the_whole(flight):
    whole = flight["/truth/state"]
    chunks = list(flight.chunks("/truth/state", rows=1000))
    assert max(map(len, chunks)) == 1000 and len(chunks) > 2
    assert np.concatenate([chunk["x_m"] for chunk in chunks]).tobytes() == whole["x_m"].tobytes()
    first = next(flight.chunks("/truth/state", rows=10))
    assert len(first) == 10


def test_some_fields_alone_have_the_values_of_whole_samples(flight):
    whole = flight.between(5.0, 20.0)["/nav/state"]
    part = flight.between(5.0, 20.0).read(["/nav/state"], fields=["std", "x_m"])["/nav/state"]
    assert set(part.fields) == {"stamp_ns", "x_m", "std"} and part.dtype.itemsize == 8 * 9
    assert np.array_equal(part["std"], whole["std"]) and np.array_equal(part.t_s, whole.t_s)
    chunks = flight.between(5.0, 20.0).chunks("/nav/state", rows=77, fields=["x_m"])
    assert np.array_equal(np.concatenate([chunk["x_m"] for chunk in chunks]), whole["x_m"])
    with pytest.raises(KeyError, match="no field 'z_m'"):
        flight.read(["/nav/state"], fields=["z_m"])


def test_slices_by_time_and_phase_hold_what_was_published_in_them(flight):
    whole = flight["/nav/state"]
    part = flight.between(10.0, 12.5)["/nav/state"]
    t_s = (whole["published_ns"].astype(np.int64) - flight.start_ns) * 1e-9
    assert np.array_equal(part["sequence"], whole["sequence"][(t_s >= 10.0) & (t_s <= 12.5)]) and len(part) > 100
    phase = flight.phases[1]
    states = flight.phase(phase.name)["/mission/state"]
    assert set(states["phase"][:-1]) == {0} and phase.stop_s > phase.start_s
    with pytest.raises(KeyError, match="there is no phase 'lunch'"):
        flight.phase("lunch")
    with pytest.raises(ValueError, match="empty"):
        flight.between(3.0, 2.0)


def test_resampled_topics_share_their_times(flight):
    both = flight.resample(["/nav/state", "/truth/state"], rate_hz=50.0)
    nav, truth = both["/nav/state"], both["/truth/state"]
    assert np.allclose(nav.t_s, truth.t_s) and np.allclose(np.diff(nav.t_s), 0.02)
    settled = nav.t_s > 5.0
    assert np.abs(nav["x_m"] - truth["x_m"])[settled].max() < 2e-3
    exact = flight["/nav/state"][100:200]
    assert exact.resample(exact.t_s)["x_m"].tobytes() == exact["x_m"].tobytes()


def test_tables_for_other_packages_have_the_same_numbers(flight):
    nav = flight["/nav/state"]
    frame = nav.to_pandas() if optional("pandas") else None
    assert frame["std.2"].to_numpy().tobytes() == nav["std"][:, 2].tobytes()
    optional("polars")
    assert nav.to_polars()["x_m"].to_numpy().tobytes() == nav["x_m"].tobytes()
    assert "arrive" in " ".join(flight["/events"].to_polars()["text"])
    optional("xarray")
    assert nav.to_xarray()["std"].dims == ("t_s", "std_index")


def test_a_log_tells_what_flew(flight):
    assert fss.Plant.parse(flight.attachments["laboratory.toml"].decode()).effects[0].index == 3
    assert flight.is_complete and flight.summary["outcome"] == "done"
    assert any(event.service == "thrusters" for event in flight.events)
    assert pickle.loads(pickle.dumps(flight["/gyro"])).t_s[5] == flight["/gyro"].t_s[5]


def test_a_log_that_was_cut_off_gives_what_is_whole(flight, tmp_path):
    data = flight.path.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 2])
    log = fss.Log(cut)
    whole, part = flight["/nav/state"], log["/nav/state"]
    assert not log.is_complete and log.damage["cut_off_bytes"] > 0
    assert 0 < len(part) < len(whole) and part.tobytes() == whole[: len(part)].tobytes()


def test_misuse_is_told_and_ends_nothing(flight, tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing.mcap"):
        fss.Log(tmp_path / "nothing.mcap")
    no_log = tmp_path / "no_log.mcap"
    no_log.write_text("not a log at all")
    with pytest.raises(fss.Error, match="no_log.mcap") as refused:
        fss.Log(no_log)
    assert refused.value.file == str(no_log)
    with pytest.raises(TypeError):
        fss.Log(7)
    with pytest.raises(KeyError, match="/nav/stat"):
        flight["/nav/stat"]
    with pytest.raises(TypeError, match="list of topics"):
        flight.read("/nav/state")
    with fss.Log(flight.path) as log:
        samples = log["/gyro"]
    with pytest.raises(ValueError, match="closed"):
        log["/gyro"]
    assert len(samples) > 1000


def test_a_thousand_opened_and_closed_logs_leave_no_memory_behind(flight, tmp_path):
    short = tmp_path / "short.mcap"
    short.write_bytes(flight.path.read_bytes()[:110_000])

    def use(times):
        for _ in range(times):
            with fss.Log(short) as log:
                log.between(0.0, 0.5)["/gyro"]["omega_rad_s"].sum()
                next(log.chunks("/gyro", rows=50))
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = use(100)
    assert use(1000) - before < 8 * 1024  # KiB
