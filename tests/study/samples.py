"""A study that uses every key of the format, and a way to write changed copies of it."""

import numpy as np

STUDY = """\
format = "scan2flex-study/1"
title = "PTFE single-core cable"
gravity = [0.0, 0.0, -9.81]

[cable]
length = 0.90
radius = 0.004
length_density = 0.336
shear_stiffness = [1.0e5, 2.0e5]
axial_stiffness = 1.0e5
torsional_stiffness = 0.03
natural_curvature = [0.0, 0.1, 0.0]
natural_stretch = [0.0, 0.0, 0.0]

[tolerance]
length = 0.002
clamp_rotation = 0.01

[unknown.bending_stiffness]
guess = 0.1
range = [1.0e-3, 1.0e2]

[unknown.point_mass.mass]

[unknown.natural_curvature]
guess = [0, 0, 0]
range = [[-1, -1, -1], [1, 1, 1]]

[[pose]]
name = "sag"
role = "fit"
start = { position = [0.0, 0.0, 0.0], quaternion = [0.7071068, 0.0, 0.7071068, 0.0] }
end = { position = [0.5, 0.0, 0.0], quaternion = [0.7071068, 0.0, 0.7071068, 0.0] }
turns = -1
centre_curve = "shapes/sag.csv"
scan = "sag.xyz"
guide_points = "sag-guides.csv"
viewpoints = [[0.5, -1.0, 0.3]]
noise = 0.001

[[pose]]
name = "again"
role = "validate"
start = { position = [0.0, 0.0, 0.0], quaternion = [0.7071068, 0.0, 0.7071068, 0.0] }
end = { position = [0.5, 0.0, 0.0] }
centre_curve = "again.csv"
repeat_of = "sag"

[[effect]]
kind = "point_mass"
position = 0.42

[[effect]]
kind = "elastic_clamp"
stiffness = [1.0, 2.0]
"""


def curve(n=40, span=0.5, length=0.9):
    """An arc of a circle over `span` (m) along x that hangs down, `length` (m) long."""
    half = np.linspace(1e-3, np.pi, 20000)
    half = half[np.argmin(np.abs(np.sin(half) / half - span / length))]
    t = np.linspace(-half, half, n)
    radius = length / (2 * half)
    return np.stack([radius * (np.sin(t) + np.sin(half)), 0 * t, radius * (np.cos(half) - np.cos(t))], axis=1)


def csv(table, header="x,y,z"):
    """The text of a CSV."""
    return "\n".join([header, *(",".join(map(repr, row)) for row in np.asarray(table).tolist()), ""])


def write_sample(folder, text=STUDY, **files):
    """Write the study and its files; `files` replaces some, by stem."""
    s = np.linspace(0, 0.9, 40)
    contents = {
        "shapes/sag.csv": csv(curve()),
        "again.csv": csv(np.column_stack([s, curve()]), "s,x,y,z"),
        "sag-guides.csv": csv(curve(5)),
        "sag.xyz": "0 0 0\n0.1 0 0\n",
    }
    for name, content in {**contents, **{f"{key}.csv": value for key, value in files.items()}}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "study.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder
