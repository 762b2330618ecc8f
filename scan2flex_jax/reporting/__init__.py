"""The report: one self-contained HTML page about a fit or an explanation.

`contents` gathers what is said, `parts` lays it out in its order with the pictures of `plot` (`figures`), as `html`, and
`page` puts it together. Poses in space need plotly, of the extra ``[report]``.
"""

from scan2flex_jax.reporting.page import report, require_libraries, save_report

__all__ = ["report", "require_libraries", "save_report"]
