"""Searches kept beside the compiled functions, from which `plan` and `report` continue where `explain` has searched before.

The key is a digest of all files of the study, the number of elements and the version of the program, so that a search of other
files is never found. An entry is data, with a checksum (`cache.Entries`), and is used only where its scores are reproduced.
"""

import hashlib
import json
from pathlib import Path

from scan2flex_jax.cache import Entries


def explained(study, elements: int | None, progress, folder: Path | None, *, again: bool):
    """The explanation of a study that was read from files; ``again``: search even if a search is kept in the ``folder``."""
    from scan2flex_jax.inference import explain  # noqa: PLC0415

    entries, key = (None if folder is None else Entries(folder)), _key(study, elements)
    kept = None if entries is None or key is None or again else entries.get(key)
    result = explain(study, elements=elements, progress=progress, record=None if kept is None else json.loads(kept))
    if entries is not None and key is not None and result.record:
        entries.put(key, json.dumps(result.record).encode())
    return result


def _key(study, elements: int | None) -> str | None:
    """The key of a search; None where the program cannot tell its own version, or a file is gone."""
    from scan2flex_jax.programs import version  # noqa: PLC0415
    from scan2flex_jax.study.outputs import measured_files  # noqa: PLC0415

    program = version()
    if program is None or study.folder is None:
        return None
    digest = hashlib.sha256(program + repr(elements).encode())
    for path in measured_files(study):
        try:
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        except OSError:
            return None
    return f"search-{digest.hexdigest()}"
