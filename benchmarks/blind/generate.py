"""Command line: `python -m benchmarks.blind.generate --cases OUT/cases --answers OUT/answers --count 200 --seed N`.

A fifth of the cases miss nothing, half miss one catalogue effect (all kinds in turn), 15 % two, and 15 % an effect
outside of the catalogue; their order is random. Cases whose answer exists are left alone, so that a run can be
resumed; a design that fails its checks is drawn again. `--kinds none kink point_mass+tether off:wavy_mass` makes
exactly these truths instead of the mix. `--background` makes the class of cases with a background (`background.py`)
instead: a third with nothing else, and one catalogue effect in the others. The study of `scan2flex demo` is `--kinds
stiffness_profile --strength 15 --points 60 --seed 55 --count 1`.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from . import background, cases, effects, studies

ATTEMPTS = 60
MOST_POINTS = 250  # of a pose
NEVER_TOGETHER = [{"nonlinear_bending", "anisotropic_bending"}, {"nonlinear_bending", "bend_twist_coupling"}]


def schedule(count, seed):
    """The truths of all cases, `(kinds, off)`, in random order."""
    rng = np.random.default_rng([seed, 0, 0, 1])
    names, hidden = list(rng.permutation(list(effects.CATALOGUE))), list(rng.permutation(list(effects.HIDDEN)))
    none, pairs, off = round(0.2 * count), round(0.15 * count), round(0.15 * count)
    out = [((), None)] * none + [((), hidden[k % len(hidden)]) for k in range(off)]
    while pairs:
        pair = tuple(rng.choice(names, 2, replace=False))
        if set(pair) not in NEVER_TOGETHER:
            out.append((pair, None))
            pairs -= 1
    single = count - len(out)
    out += [((names[k % len(names)],), None) for k in range(single)]
    return [out[k] for k in rng.permutation(count)]


def parse(text):
    """A truth in words: `none`, `kink`, `kink+tether` or `off:wavy_mass`."""
    if text.startswith("off:"):
        return (), text[4:]
    return (() if text == "none" else tuple(text.split("+"))), None


def run(arguments):
    mix = background.schedule if arguments.background else schedule
    truths = [parse(t) for t in arguments.kinds] if arguments.kinds else mix(arguments.count, arguments.seed)
    if arguments.background and arguments.strength:
        sys.exit("--strength is not for --background, whose effects are as strong as their background asks")
    if arguments.background and any(off or len(kinds) > 1 for kinds, off in truths):
        sys.exit("with --background, each of --kinds is `none` or one kind of the catalogue")
    for index, (kinds, off) in enumerate(truths):
        name = f"{arguments.prefix}{index + 1:03d}"
        if (Path(arguments.answers) / f"{name}.toml").exists():
            continue
        for trial in range(ATTEMPTS):
            key, named = (arguments.seed, index, trial), tuple(map(str, kinds))
            try:
                if arguments.background:
                    made = background.make_case(key, named, arguments.points)
                else:
                    made = cases.make_case(key, named, off and str(off), arguments.points, arguments.strength)
            except (np.linalg.LinAlgError, FloatingPointError):
                continue
            if made is not None:
                rng, case = made
                studies.write(rng, {"id": name, **case}, arguments.cases, arguments.answers)
                print(f"{name}: attempt {trial + 1}, {case['answer']['seconds']} s", flush=True)
                break
        else:
            print(f"{name}: no design in {ATTEMPTS} attempts", file=sys.stderr, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", required=True, help="folder of the studies")
    parser.add_argument("--answers", required=True, help="folder of the answers")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kinds", nargs="*", help="truths, one per case, instead of the mix")
    parser.add_argument("--background", action="store_true", help="cases with a background")
    parser.add_argument("--points", type=int, default=MOST_POINTS, help="most points per pose")
    parser.add_argument("--strength", type=float, help="strength of every effect, instead of one that is drawn")
    parser.add_argument("--prefix", default="b")
    run(parser.parse_args())


if __name__ == "__main__":
    main()
