"""Systems under periodic loads."""

OSCILLATOR = {
    "parameters": {"A": 1.0, "w": 2.8, "d": -0.05, "r": 0.8},
    "system": {"mass": [[1.0]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "d", "restitution": "r"}]},
    "forces": [{"load": [1.0], "amplitude": "A", "harmonic": 1}],
}
PAIR = {
    "parameters": {"A": 0.4, "w": 1.3, "d": 1.0, "r": 0.7, "b": 0.05},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.2]], "damping": [[0.05, -0.02], [-0.02, 0.03]], "stiffness": [[1.5, -0.4], [-0.4, 0.5]],
        "stops": [{"c": [1.0, -1.0], "lower": "-d", "upper": "d", "restitution": "r"}],
    },
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}, {"load": [0.0, 1.0], "constant": "b"}],
}  # fmt: skip
ODD = {
    **PAIR,
    "parameters": {"A": 0.4, "w": 1.3, "d": 1.0, "r": 0.7},
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}, {"load": [0.2, 0.1], "amplitude": "A/3", "harmonic": 3}],
}
AUTONOMOUS = {
    "parameters": {"f": 1.0, "d": 0.3, "r": 0.6},
    "system": {"mass": [[1.0]], "damping": [[-0.1]], "stiffness": [[1.0]], "stops": [{"c": [1.0], "upper": "d", "restitution": "r"}]},
    "forces": [{"load": [1.0], "constant": "f"}],
}
HELD = {
    "parameters": {"A": 0.9, "w": 1.1, "d": 0.2, "g": 0.7},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.4]], "damping": [[0.1, 0.0], [0.0, 0.05]], "stiffness": [[1.0, -0.3], [-0.3, 0.8]],
        "stops": [{"c": [1.0, 0.0], "upper": "d", "restitution": 0.0}, {"c": [0.0, 1.0], "upper": 0.9, "lower": "-g", "restitution": 0.6}],
    },
    "forces": [{"load": [1.0, 0.3], "amplitude": "A", "harmonic": 1}],
}  # fmt: skip

FLOATING = {
    "parameters": {"A": 0.8, "w": 1.7, "d": 0.4, "g": 0.3},
    "system": {
        "mass": [[1.0, 0.0], [0.0, 0.5]], "damping": [[0.02, -0.02], [-0.02, 3.0]], "stiffness": [[1.0, -1.0], [-1.0, 1.0]],
        "stops": [{"c": [1.0, -1.0], "lower": "-d", "upper": "d", "restitution": 0.5}],
    },
    "forces": [{"load": [1.0, 0.0], "amplitude": "A", "harmonic": 1}, {"load": [0.2, 0.1], "constant": "g"}],
}  # fmt: skip
FREE = {**FLOATING, "system": {**FLOATING["system"], "damping": [[0.0, 0.0], [0.0, 0.0]]}}
