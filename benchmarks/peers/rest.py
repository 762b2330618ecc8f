"""When a damped motion counts as rest, the same for every relaxation code.

A node that moves at v near the end of a motion of angular frequency w still has about v/w to go. Rest to a tolerance means
that for a quarter of the slowest period no node had more than tolerance x L to go. Tolerances are tried from the loosest:
a code whose elements are wrong by 1e-2 gains nothing from the tightest one, so each is recorded with its time.
"""

from time import process_time

import numpy as np

from benchmarks.peers.problems import Solution

TOLERANCES = (1e-3, 1e-4, 1e-5)  # of the length
LONGEST = 60.0  # processor seconds for one relaxation
PERIODS = 15.0  # and simulated time, in slowest periods


def relax(problem, advance, state, seconds_per_check, longest=LONGEST) -> list[Solution]:
    """Call ``advance()`` (one check's worth of steps) until the last tolerance holds.

    ``state()`` gives ``(s, points, speed)`` with the largest speed of a node (m/s); ``seconds_per_check`` is simulated time.
    """
    begin, answers, quiet, passed = process_time(), [], dict.fromkeys(TOLERANCES, 0.0), 0.0
    while len(answers) < len(TOLERANCES):
        advance()
        passed += seconds_per_check
        s, points, speed = state()
        if not np.isfinite(speed):
            raise FloatingPointError(f"the motion diverged after {passed:.3g} s")
        left = speed / problem.slowest / problem.length
        for tolerance in TOLERANCES[len(answers) :]:
            quiet[tolerance] = quiet[tolerance] + seconds_per_check if left < tolerance else 0.0
            if quiet[tolerance] < 0.5 * np.pi / problem.slowest:
                break
            facts = {"rest to": tolerance, "simulated_s": passed}
            answers.append(Solution(s.copy(), points.copy(), facts, process_time() - begin))
        if process_time() - begin > longest or passed > PERIODS * 2 * np.pi / problem.slowest:
            facts = {"rest to": None, "simulated_s": passed, "left": float(left)}
            return [*answers, Solution(s, points, facts, process_time() - begin)]
    return answers
