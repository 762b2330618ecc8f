"""`export`: a calibrated study to the text of one simulator's file."""

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export.abaqus import to_abaqus
from scan2flex_jax.export.hanging import hung, lying
from scan2flex_jax.export.moduli import to_moduli
from scan2flex_jax.export.moordyn import to_cabledyn, to_moordyn
from scan2flex_jax.export.mujoco import to_mujoco
from scan2flex_jax.export.orcaflex import to_orcaflex
from scan2flex_jax.export.plain import to_json
from scan2flex_jax.export.pyelastica import to_pyelastica
from scan2flex_jax.export.usd import to_usd
from scan2flex_jax.study.model import Study

TO = {
    "mujoco": to_mujoco, "pyelastica": to_pyelastica, "usd": to_usd, "abaqus": to_abaqus, "orcaflex": to_orcaflex,
    "moordyn": to_moordyn, "cabledyn": to_cabledyn, "moduli": to_moduli, "json": to_json,
}  # fmt: skip
SECTIONS = ("abaqus", "orcaflex", "moordyn", "cabledyn", "moduli")  # targets that take the cable's sections, and no pose


def export(study: Study, to: str, *, pose: str | None = None, elements: int = 40) -> str:
    """The calibrated cable of ``study`` as text for a simulator, hanging in one ``pose`` (default: the first).

    ``to``: "mujoco" (an XML model), "pyelastica" (a script), "usd" (an OpenUSD stage, for Newton), "abaqus" (mesh, sections),
    "orcaflex", "moordyn" and "cabledyn" (line types), "moduli" (of a solid circle of the outer diameter) or "json" (stiffness
    matrices of every element). Abaqus, line types and moduli take the sections of the cable and no pose; others reproduce the
    shape to second order in the element length. An effect of the cable is exported or refused by name; a file states its
    assumptions, such as the radius if the study has none. Raises `Scan2FlexError` for
    parameters without a value, a pose that cannot be solved, and a cable that the simulator cannot represent.
    """
    if to not in TO:
        raise Scan2FlexError(f"{to[:20]!r} is not known: export to one of {', '.join(TO)}.")
    return TO[to]((lying if to in SECTIONS else hung)(study, pose, elements))
