"""Double precision for every test, and the shapes written in the package's annotations checked at every call."""

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
install_import_hook("scan2flex_jax", "beartype.beartype")
