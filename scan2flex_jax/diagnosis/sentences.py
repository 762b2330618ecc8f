"""Sentences of `explain`: the finding, the error before and after, and doubts."""

import numpy as np

from scan2flex_jax.diagnosis import confirm, report, search, verdict
from scan2flex_jax.diagnosis.families import WORDS
from scan2flex_jax.diagnosis.result import rms_over
from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.fitting.statistics import listed

_FALLEN = 3.0  # times the error before: a validate pose that is much worse with an effect


def of_search(found, chosen, description):
    """The verdict, and the reasons against the likeliest effects."""
    p = found.test.p_value
    if found.verdict == verdict.NONE and found.floor is not None:  # its discrepancy is said next
        return (f"no missing effect shows in these shapes (p = {p:.3f})",)
    if found.verdict == verdict.NONE:
        return (f"the baseline model explains these shapes within the noise (p = {p:.3f})", *_if_noise(found))
    if found.verdict == verdict.UNSOLVED:
        return ("nothing is concluded",)
    if found.verdict == verdict.UNEXPLAINED:
        text = f"something is missing (p = {p:.3f}) and no known effect explains it"
        family, gain = max(found.test.family_gain.items(), key=lambda item: item[1])
        tail = f"; it behaves like {WORDS[family]} ({gain:.1f} nats), a description, not a cause" if gain > 0 else ""
        field = f"{description.kind} describes it along the cable: a field with a band, not a cause"
        return (text + tail, *_not_enough(found), field)
    complete = found.verdict == verdict.EXPLAINED or not found.stage.of.more_than_noise(found.best.law)
    return (explains(p, chosen, complete), *_elsewhere(found), *_indistinguishable(chosen))


def explains(p_value, chosen, complete):
    """The finding: the effects, and whether what they leave is noise."""
    names = f"{' and '.join(r.kind for r in chosen)} {'explains' if len(chosen) == 1 else 'explain'}"
    rest = "it; the remaining error is noise" if complete else "most of it; the remaining error exceeds the noise"
    return f"something is missing (p = {p_value:.3f}); {names} {rest}"


def before_and_after(poses, added, established):
    """The error before and after with the added effects, whether they are established, and validate poses that get worse."""
    if not added:
        return ()
    fitted, unseen = ({n: p for n, p in poses.items() if p.role == role} for role in ("fit", "validate"))
    was, now = (1e3 * rms_over([*fitted.values()], figure) for figure in ("rms_before", "rms"))
    effects = " and ".join(r.kind for r in added)
    text = f"with {effects} the error {'falls' if now < was else 'rises'} from {was:.2f} to {now:.2f} mm"
    for group, figures, words in (
        (fitted if len(fitted) > 1 else {}, ("left_out_before", "left_out"), "poses left out"),
        (unseen, ("rms_before", "rms"), "validate poses"),
    ):
        was, now = (1e3 * rms_over([*group.values()], figure) for figure in figures)
        text += f", in {words} from {was:.2f} to {now:.2f} mm" if np.isfinite(was) and np.isfinite(now) else ""
    fallen = {n: p for n, p in unseen.items() if p.rms > _FALLEN * p.rms_before}
    listed = ", ".join(f"{n} ({1e3 * p.rms_before:.1f} to {1e3 * p.rms:.1f} mm)" for n, p in fallen.items())
    worse = f"much worse with {effects}, perhaps on another branch: {listed}"
    return (text + ("" if established else "; this best model is not established"), *([worse] if fallen else []))


def of_discrepancy(discrepancy):
    """The discrepancy of the poses, in words."""
    if not discrepancy.curvature:
        return ()
    size = f"{1e3 * discrepancy.rms:.2f} mm, {100 * discrepancy.relative:.2f} % of the length"
    return (f"beyond the sensor's noise each pose differs in its own way ({size}): friction, handling, or unlisted physics",)


def _if_noise(found):
    """The condition under which smooth errors as large as shapes are noise of the scan."""
    n = found.stage.noise
    if found.best.law.curvature or not found.stage.of.conspicuous(n):
        return ()
    alike = "" if found.stage.of.sparse else f", alike over {1e3 * n.correlation_length:.0f} mm"
    errors = f"{1e3 * np.sqrt(2) * n.total:.1f} mm RMS{alike}"
    return (f"but only if the measured curves err by {errors}: state the noise of the scan (`noise` of a pose) to decide it",)


def if_fine(found):
    """The doubt about an effect whose displacements are below the possible error of scans."""
    bench = found.stage.bench
    rms, radius = report.rms(bench, found.stage.base.shapes), bench.context.radius_or_guess
    if rms > found.stage.settings.fine * radius:
        return ()
    error = f"the error of the baseline model is {1e3 * rms:.2f} mm, {100 * rms / radius:.0f} % of the radius"
    return (f"{error}: it may be that of the scans, which is alike along a pose seen from one side",)


def _not_enough(found):
    """The reasons why the likeliest effects do not explain the shapes."""
    names, settings, reasons = " and ".join(found.best.kinds), found.stage.settings, []
    if not names:
        return ()
    if found.best.log_evidence <= 0.0:
        reasons.append("is no likelier than the baseline model")
    elif found.best.log_evidence < settings.lead_named:
        reasons.append(f"leads by only {found.best.log_evidence:.1f} nats")
    against = confirm.compared(found.stage, found.best, found.baseline)
    if found.stage.bench.poses.count < 2:
        reasons.append("cannot be tested on a pose left out, as there is only one")
    elif against.ratio >= 1.0:
        reasons.append("predicts poses left out no better than the baseline model")
    elif against.ratio > settings.most_left or not against.better:
        reasons.append(f"reduces the error in poses left out to {100 * against.ratio:.0f} % only")
    differ = {k: v for k, v in found.scatter.items() if v is not None and v > settings.most_scatter}
    reasons += [f"differs in size between poses ({k} by {100 * v:.0f} %)" for k, v in differ.items()]
    return (f"the likeliest, {names}, {listed(reasons)}",) if reasons else ()


def left_out(poses, chosen):
    """The number of poses left out that are predicted better with the effect."""
    own = [p for p in poses.values() if p.left_out is not None and np.isfinite(p.left_out)]
    if not chosen or not own:
        return ()
    better = sum(p.left_out < p.left_out_before for p in own)
    return (f"left out in turn, {better} of {len(own)} fitted poses are predicted better with it than without",)


def _elsewhere(found):
    """Other places along the cable at which the effect is as likely."""
    at = [f"{r.components[0].site['position']:.3g} m" for r in search.minima_elsewhere(found)]
    return (f"{found.best.kinds[0]} at {' or '.join(at)} is about as likely: the intervals include it",) if at else ()


def _indistinguishable(chosen):
    """Errors of the input that give the same shapes as an effect."""
    same = [(r.kind, same) for r in chosen for same in search.errors_of_the_study(entry_of(r.kind))]
    return tuple(
        f"shapes alone cannot tell {kind} from an error of the {s.other.replace('_', ' ')}: {s.words}" for kind, s in same
    )
