"""The generator of blind studies, checked against solvers and closed forms that it does not use."""
