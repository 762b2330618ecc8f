"""The rod: a cable's parameters, its supports, the effects upon it, its energy and the derivatives of that energy."""
