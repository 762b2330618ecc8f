"""`export`: one cable, one pose, one format."""

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export.hanging import hung
from scan2flex_jax.export.mujoco import to_mujoco
from scan2flex_jax.export.plain import to_json
from scan2flex_jax.export.pyelastica import to_pyelastica
from scan2flex_jax.export.usd import to_usd
from scan2flex_jax.study.model import Study

TO = {"mujoco": to_mujoco, "pyelastica": to_pyelastica, "usd": to_usd, "json": to_json}


def export(study: Study, to: str, *, pose: str | None = None, elements: int = 40) -> str:
    """The calibrated cable of ``study`` as text for a simulator, hanging in one ``pose`` (left out, the first).

    ``to``: "mujoco" (an XML model), "pyelastica" (a script), "usd" (an OpenUSD stage, for Newton) or "json" (stiffness matrices
    of every element). Simulators place a cable to second order in the length of ``elements``. An effect of the cable goes along
    or is refused by name; a file says what it assumes, as the radius of a study that has none. Raises `Scan2FlexError` for
    parameters without a value, a pose that cannot be solved, and a cable that the simulator cannot represent.
    """
    if to not in TO:
        raise Scan2FlexError(f"{to[:20]!r} is not known: export to one of {', '.join(TO)}.")
    return TO[to](hung(study, pose, elements))
