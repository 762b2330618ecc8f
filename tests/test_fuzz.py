"""Any bytes, to every reader that `benchmarks/fuzz.py` knows: what the file says, or one sentence. There it is thousands."""

import signal

import numpy as np
import pytest

from benchmarks import fuzz

INPUTS = 60


@pytest.fixture(scope="module")
def readers(tmp_path_factory):
    return fuzz.readers(tmp_path_factory.mktemp("fuzz"))


@pytest.fixture(autouse=True)
def told_of_hangs():
    before = signal.signal(signal.SIGPROF, fuzz._hung)
    yield
    signal.signal(signal.SIGPROF, before)


def test_every_reader_refuses_in_one_sentence_or_reads(readers):
    for k, reader in enumerate(readers.values()):
        rng = np.random.default_rng(k)
        for _ in range(INPUTS):
            fuzz.attempt(reader, fuzz.mutated(rng, reader.seeds))
    assert {name: reader.failures for name, reader in readers.items() if reader.failures} == {}
    assert all(reader.refused > 0 for reader in readers.values())


def test_valid_files_are_read(readers):
    for name, reader in readers.items():
        for data in reader.seeds:
            assert reader.read(data) is not None, name


def test_what_goes_wrong_is_kept():
    def broken(data):
        raise KeyError("a\nb") if data else MemoryError

    reader = fuzz.Reader(broken, [b"x"])
    fuzz.attempt(reader, b"x")
    fuzz.attempt(reader, b"")
    assert {fault.split(" ")[0] for fault in reader.failures} == {"KeyError", "MemoryError"}
    assert reader.failures["KeyError from ?"]["input"] == "eA=="


def test_a_reader_that_hangs_is_stopped(monkeypatch):
    def endless(data):
        while True:
            pass

    monkeypatch.setattr(fuzz, "LIMIT_S", 0.05)
    reader = fuzz.Reader(endless, [b"x"])
    fuzz.attempt(reader, b"x")
    assert list(reader.failures) == ["hang"]
