"""The report: one self-contained HTML page about a fit or an explanation, which needs no network to be read.

`contents` gathers what is said, `figures` draws it with plotly, `page` lays it out with jinja2. Both libraries come with the
extra ``[report]``.
"""

from scan2flex_jax.reporting.page import report, require_libraries, save_report

__all__ = ["report", "require_libraries", "save_report"]
