"""Double precision for every test, the shapes written in the package's annotations checked at every call, and one cache of
compiled functions for all processes of a run."""

from pathlib import Path

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parents[1] / ".pytest_cache" / "compiled"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
install_import_hook("scan2flex_jax", "beartype.beartype")
