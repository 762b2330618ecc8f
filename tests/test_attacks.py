"""Any bytes, to every reader that `benchmarks/attacks.py` knows: the contents, or one sentence. There it is thousands."""

import signal

import numpy as np
import pytest

from benchmarks import attacks

INPUTS = 20


@pytest.mark.slow
def test_every_reader_refuses_in_one_sentence_or_reads(tmp_path):
    readers = attacks.readers(tmp_path)
    before = signal.signal(signal.SIGPROF, attacks._hung)
    try:
        for k, reader in enumerate(readers.values()):
            rng = np.random.default_rng(k)
            if reader.mutate:
                assert all(reader.read(data) is not None for data in reader.seeds)
            else:
                reader.seeds = [reader.seeds[i] for i in rng.choice(len(reader.seeds), INPUTS, replace=False)]
            for n in range(INPUTS):
                attacks.attempt(reader, attacks.mutated(rng, reader.seeds) if reader.mutate else reader.seeds[n])
    finally:
        signal.signal(signal.SIGPROF, before)
    assert {name: reader.failures for name, reader in readers.items() if reader.failures} == {}
    assert all(reader.refused > 0 for reader in readers.values())
