"""The rod: cable parameters, supports, effects, potential energy and the energy's derivatives."""
