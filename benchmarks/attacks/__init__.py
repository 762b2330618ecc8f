"""Attacks on the package: whatever is given to it, it works, or refuses in one sentence, and nothing of the user's is lost.

    python -m benchmarks.attacks [--seed 0] [--only CLASS]

A *try* gives the package one hostile thing, in this process or in one of its own; a *class* holds tries of one kind:

    values         wrong values of every field: in study.toml, in memory, of the rod, of options   (`values`, `memory`)
    names          poses whose names attack paths, terminals, pictures and pages                   (`names`)
    outputs        results onto the study's own files, foreign files, links, devices, full disks   (`outputs`, `targets`)
    sizes          files that are large, sparse, packed, deep, or other than they say              (`sizes`)
    stores         sweep stores whose bytes have changed                                           (`stores`)
    caches         damaged entries of the cache of compiled functions; processes that share one    (`caches`)
    kills          SIGKILL at any moment of fit, explain, report and extract                       (`kills`)
    surroundings   no home, another user, a read-only installation, closed streams, few resources  (`surroundings`)

A try fails when an exception other than `Scan2FlexError` comes out, or an exit code that is not 0, 2 or 3; when a refusal is
not one line; when a file of the study changes or goes; when a file appears outside of what the try may write, or a temporary
one stays; when it takes more than `LIMIT_S` seconds or `LIMIT_MB`; or when the answer is wrong (`WrongError`). Failures are
listed with the first example of each, and end the run with exit code 1. The same seed gives the same tries; the record is
`benchmarks/results/attacks.json`.
"""
